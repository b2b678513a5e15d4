"""Work of a process that says how far it is."""

from collections.abc import Callable

from service.processes.worker import tell


def telling() -> Callable[[int], str]:
    def answer(request: int) -> str:
        for number in range(request):
            tell(number)
        return "done"

    return answer
