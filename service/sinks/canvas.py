"""A sheet of panels in 246 colours: images, their scales and titles, drawn in hundredths of a second.

What is drawn is the number of a colour, so that nothing is three bytes wide and the file is half as large. A
library of plots takes ten times as long, and seconds to import.
"""

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Colours = Literal["grey", "viridis", "magma", "red-blue"]

BOX = 432, 353
"""Columns and rows of a panel's image at most."""

_SIZE = 1600, 860
_LEFT, _TOP, _RIGHT, _DOWN = 16, 76, 530, 405
"""Pixels: of the first panel's image, and from one panel to the next."""
_BAR, _BAR_GAP = 16, 14
_TICKS = 7
"""At most so many along a scale."""

_LEVELS = 80
"""Of each of three scales of colours; finer than the eye tells apart."""
_BLACK, _WHITE = 0, _LEVELS - 1
_LIGHT, _DARK = 3 * _LEVELS, 3 * _LEVELS + 1
_BACKGROUNDS = ((0xC8, 0xC8, 0xC8), (0x20, 0x24, 0x2C))
MARKS = ((0x00, 0x00, 0x00), (0xFF, 0xFF, 0xFF), (0xE0, 0x45, 0x7B), (0xB8, 0xB8, 0xB8))
"""Colours of marked pixels, none of which is on the scale of a depth."""

_RED_BLUE = (
    (5, 48, 97), (33, 102, 172), (67, 147, 195), (146, 197, 222), (209, 229, 240), (247, 247, 247),
    (253, 219, 199), (244, 165, 130), (214, 96, 77), (178, 24, 43), (103, 0, 31),
)  # fmt: skip
"""ColorBrewer's diverging scale RdBu, from below to above (Harrower, Brewer, 2003)."""


@dataclass(frozen=True, slots=True)
class Panel:
    """One image, what it is called, and how it is coloured.

    Attributes:
        image: (H, W); NaN is painted as background.
        colours: of its scale.
        title: with the unit.
        low, high: ends of the scale; what lies beyond has their colours.
        root: coloured by the square root of its values.
        scale: whether the scale stands beside it.
        dark: of background.
        marks: (H, W) which pixels are painted in one of `MARKS` instead, counted from 1; 0 = none.
        names: of the marks, told below.
    """

    image: NDArray[Any]
    colours: Colours
    title: str
    low: float
    high: float
    root: bool = False
    scale: bool = True
    dark: bool = False
    marks: NDArray[np.uint8] | None = None
    names: tuple[str, ...] = ()


def draw(panels: list[Panel], title: str) -> Image.Image:
    """Six panels, three to a row, under a title; at most one of `magma` and `red-blue` among them."""
    sheet = Image.new("L", _SIZE, _WHITE)
    pen = ImageDraw.Draw(sheet)
    pen.text((_SIZE[0] / 2, 20), title, fill=_BLACK, font=_font(16), anchor="mm")
    third: Colours = "magma"
    for place, panel in enumerate(panels):
        if panel.colours in ("magma", "red-blue"):
            third = panel.colours
        _draw_panel(sheet, pen, panel, _LEFT + place % 3 * _RIGHT, _TOP + place // 3 * _DOWN)
    sheet.putpalette(_palette(third))
    return sheet


def _draw_panel(sheet: Image.Image, pen: ImageDraw.ImageDraw, panel: Panel, left: int, top: int) -> None:
    image = _fitted(panel.image)
    rows, columns = image.shape
    numbers = _numbers(image, panel)
    if panel.marks is not None:
        marks = _fitted(panel.marks)
        numbers = np.where(marks, np.uint8(_DARK) + marks, numbers)
    sheet.paste(Image.fromarray(numbers), (left, top))
    pen.rectangle((left - 1, top - 1, left + columns, top + rows), outline=_BLACK)
    middle = left + columns / 2
    pen.text((middle, top - 6), panel.title, fill=_BLACK, font=_font(14), anchor="mb")
    if panel.scale:
        _draw_scale(sheet, pen, panel, (left + columns + _BAR_GAP, top), rows)
    x, y = float(left), top + rows + 6
    for mark, name in enumerate(panel.names, 1):
        pen.rectangle((x, y, x + 12, y + 12), fill=_DARK + mark, outline=_BLACK)
        pen.text((x + 17, y + 6), name, fill=_BLACK, font=_font(12), anchor="lm")
        x += 17 + pen.textlength(name, _font(12)) + 12


def _draw_scale(
    sheet: Image.Image, pen: ImageDraw.ImageDraw, panel: Panel, corner: tuple[int, int], rows: int
) -> None:
    left, top = corner
    bar = np.linspace(_WHITE, 0, rows).round().astype(np.uint8) + _first(panel.colours)
    sheet.paste(Image.fromarray(bar[:, None].repeat(_BAR, axis=1)), corner)
    pen.rectangle((left - 1, top - 1, left + _BAR, top + rows), outline=_BLACK)
    for value, label in _ticks(panel.low, panel.high):
        y = top + (rows - 1) * (1 - float(_share(np.array(value), panel)))
        pen.line((left + _BAR, y, left + _BAR + 4, y), fill=_BLACK)
        pen.text((left + _BAR + 7, y), label, fill=_BLACK, font=_font(12), anchor="lm")


def _fitted(image: NDArray[Any]) -> NDArray[Any]:
    """The image, as large as the box takes it, by its nearest pixels."""
    rows, columns = image.shape
    scale = min(BOX[0] / columns, BOX[1] / rows)
    row, column = (
        np.minimum(((np.arange(max(1, round(many * scale))) + 0.5) / scale).astype(int), many - 1)
        for many in (rows, columns)
    )
    fitted: NDArray[Any] = image[row][:, column]
    return fitted


def _numbers(image: NDArray[Any], panel: Panel) -> NDArray[np.uint8]:
    share = _share(image, panel)
    known = np.isfinite(share)
    number = (np.where(known, share, 0) * (_LEVELS - 1) + (0.5 + _first(panel.colours))).astype(np.uint8)
    return np.where(known, number, np.uint8(_DARK if panel.dark else _LIGHT))


def _share(values: NDArray[Any], panel: Panel) -> NDArray[np.float32]:
    """Where values lie between the ends of the scale, 0 to 1."""
    share = (values.astype(np.float32) - np.float32(panel.low)) / np.float32(panel.high - panel.low)
    share = np.clip(share, 0, 1)
    return np.asarray(np.sqrt(share) if panel.root else share)


def _first(colours: Colours) -> int:
    return {"grey": 0, "viridis": _LEVELS}.get(colours, 2 * _LEVELS)


def _ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Round values from one end to the other, and how they are written."""
    least = (high - low) / _TICKS
    power = 10.0 ** np.floor(np.log10(least))
    step = next(step for step in (power, 2 * power, 5 * power, 10 * power) if step >= least * (1 - 1e-9))
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    values = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
    return [(float(value), f"{value + 0.0:.{digits}f}".replace("-", "−")) for value in values]


@cache
def _palette(third: Colours) -> bytes:
    import cv2

    at = np.linspace(0, 255, _LEVELS).round().astype(np.uint8)[:, None]
    scales = [at.repeat(3, axis=1), cv2.applyColorMap(at, cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]]
    if third == "red-blue":
        ends = np.linspace(0, 255, len(_RED_BLUE))
        scales.append(np.stack([np.interp(at[:, 0], ends, one) for one in np.transpose(_RED_BLUE)], -1))
    else:
        scales.append(cv2.applyColorMap(at, cv2.COLORMAP_MAGMA)[:, 0, ::-1])
    return np.concatenate([*scales, np.array(_BACKGROUNDS + MARKS)]).round().astype(np.uint8).tobytes()


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which Matplotlib brings along; importing that takes too long."""
    found = find_spec("matplotlib")
    assert found is not None
    assert found.origin is not None
    return ImageFont.truetype(
        str(Path(found.origin).with_name("mpl-data") / "fonts/ttf/DejaVuSans.ttf"), size
    )
