"""The picture of an FMU: drawn by code, the same bytes each time."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]

SIZE = 128  # pixels; FMI 3.0 requires at least 100
_WHITE, _DARK, _GREY, _BLUE = range(4)
_COLOURS = bytes([255, 255, 255, 51, 51, 51, 170, 170, 170, 0, 114, 178])


def icon(is_plant: bool, is_controller: bool) -> bytes:
    """A PNG: the block on its screw for a plant, a step response for a controller, both for a loop.

    Parameters
    ----------
    is_plant, is_controller : bool
    """
    image = np.full((SIZE, SIZE), _WHITE, dtype=np.uint8)
    image[[0, 1, -2, -1], :] = _DARK
    image[:, [0, 1, -2, -1]] = _DARK
    both = is_plant and is_controller
    if is_plant:
        _draw_axis(image, 92 if both else 64)
    if is_controller:
        _draw_response(image, 60 if both else 96, 40 if both else 64)
    return _png(image)


def _draw_axis(image: Image, middle: int) -> None:
    """Motor on the left, screw along the middle, block on it."""
    image[middle - 4 : middle + 4, 12:116] = _GREY
    across, along = np.mgrid[-4:4, 36:116]
    image[middle - 4 : middle + 4, 36:116][(along + across) % 8 < 2] = _DARK
    image[middle - 14 : middle + 14, 12:36] = _DARK
    image[middle - 20 : middle + 20, 62:92] = _BLUE


def _draw_response(image: Image, bottom: int, height: int) -> None:
    """A set-point step and the response."""
    along = np.arange(16, 114)
    follows = 1 - np.exp(-(along - 30).clip(0) / 14) * np.cos((along - 30).clip(0) / 12)
    for column, share in zip(along, follows, strict=True):
        asked = bottom - (height if column >= 30 else 0) * 3 // 4
        image[asked - 1 : asked + 1, column] = _GREY
        row = bottom - round(float(share) * height * 3 / 4)
        image[row - 2 : row + 2, column - 1 : column + 2] = _BLUE
    image[bottom - height : bottom + 4, 14:16] = _DARK
    image[bottom + 2 : bottom + 4, 14:116] = _DARK


def _png(image: Image) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    rows = b"".join(b"\0" + row.tobytes() for row in image)
    header = struct.pack(">IIBBBBB", SIZE, SIZE, 8, 3, 0, 0, 0)  # eight bits, by a palette
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"PLTE", _COLOURS)
        + chunk(b"IDAT", zlib.compress(rows, 9))
        + chunk(b"IEND", b"")
    )
