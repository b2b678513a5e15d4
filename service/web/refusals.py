"""What is said to a request that gets nothing else."""

from collections.abc import Mapping

from starlette.responses import JSONResponse


def refusal(status: int, code: str, message: str, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """`{"code", "message"}`, as the rig's commands say it."""
    return JSONResponse({"code": code, "message": message}, status, headers)
