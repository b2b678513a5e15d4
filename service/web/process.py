"""What runs inside the page's process beside the daemon: it starts the server, then says that it works."""

from collections.abc import Callable

from service.errors import ServiceError
from service.web.options import PageOptions
from service.web.server import PageServer


def serving() -> Callable[[dict[str, object] | None], str]:
    """What answers each request in turn: options (where it is then), or None (empty while it works).

    Errors are told in words that begin with `error: `.
    """
    page: PageServer | None = None

    def answer(request: dict[str, object] | None) -> str:
        nonlocal page
        try:
            if request is not None:
                page = PageServer(PageOptions.model_validate(request)).start()
                return page.url
            assert page is not None
            page.check()
        except ServiceError as error:
            return f"error: {error}"
        return ""

    return answer
