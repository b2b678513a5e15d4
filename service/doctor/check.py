"""One thing that the doctor looks at."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Check(BaseModel):
    """One thing that was looked at."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    state: Literal["ok", "warning", "problem"]
    finding: str
    remedy: str | None = Field(None, description="The line to run, or what to do.")
