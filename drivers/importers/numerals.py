"""Numbers in text, however the writer's compiler and country spell them."""

import codecs
import re

import numpy as np
from numpy.typing import NDArray

_NOT_FINITE = re.compile(
    r"(?<![^\s;,])[-+]?(?:\d[.,]#[a-z]+\d*|nan(?:\([\w ]*\))?|inf(?:inity)?)(?![^\s;,])", re.IGNORECASE
)
"""`nan`, `-nan(ind)`, and what older Microsoft compilers print: `-1.#IND`, `1.#QNAN`, `1.#INF`, `1.#J`."""

_POINT = re.compile(r"\d\.\d")
_TWO_COMMAS = re.compile(r",[^\s;,]+,")


def decode(content: bytes) -> str:
    """Text in UTF-8, or in UTF-16 with its byte order mark; lines end in `\\n` whatever they ended in.

    Bytes that are no text are replaced: in a title they do no harm, in a number they are refused later.

    Raises:
        ValueError: binary data.
    """
    marked = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    text = content.decode("utf-16" if marked else "utf-8-sig", errors="strict" if marked else "replace")
    if "\0" in text:
        raise ValueError("binary data")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def decimal_comma(text: str) -> bool:
    """Whether a comma is the decimal mark: no number has a point, and none has two commas."""
    return "," in text and not _POINT.search(text) and not _TWO_COMMAS.search(text)


def plain(text: str, *, comma: bool) -> str:
    """Numbers spelt as Python reads them, apart by white space; whatever is not finite becomes `nan`."""
    text = _NOT_FINITE.sub("nan", text)
    text = text.replace(",", "." if comma else " ")
    return text.replace(";", " ")


def rows(text: str) -> list[NDArray[np.float64]]:
    """The numbers of `plain` text, one array for each line that has any.

    Raises:
        ValueError: a word that is no number.
    """
    if "_" in text:
        raise ValueError("'_' is in no number")
    lines = (line.split() for line in text.splitlines())
    return [np.array([float(word) for word in line], dtype=np.float64) for line in lines if line]
