"""Frames to files: WebP and GIF with Pillow, mp4 with imageio-ffmpeg where it is installed."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import MissingPackageError
from vofem.io.pictures import drawing, links

Frame = NDArray[np.uint8]

#: Suffixes of movies.
SUFFIXES = (".webp", ".gif", ".mp4")

#: Shades of every colour of a picture towards white in the palette of a GIF, and colours of bending moments.
_SHADES, _MOMENTS = 8, 64

#: GIF counts time in hundredths of a second, and players take less than two of them for ten.
_GIF_TICK, _GIF_FEWEST = 100.0, 2


def true_rate(suffix: str, fps: float) -> float:
    """Return the frames per second that a movie of this kind will have: GIF rounds their duration to 0.01 s."""
    return _GIF_TICK / max(_GIF_FEWEST, round(_GIF_TICK / fps)) if suffix == ".gif" else fps


def check(suffix: str) -> None:
    """Raise `MissingPackageError` where a movie of this kind cannot be written here."""
    if suffix == ".mp4":
        _ffmpeg()
    elif suffix == ".webp":
        from PIL import features

        if not features.check("webp"):
            raise MissingPackageError(
                "animate: this Pillow cannot write WebP; install another one with python -m pip install -U pillow, or "
                "choose a path that ends in .gif"
            )


def write(frames: Iterable[Frame], path: Path, suffix: str, fps: float) -> None:
    """Write frames, each of shape (height, width, 3), to a file.

    `path`: where they are written; its own suffix does not matter.
    `suffix`: one of `SUFFIXES`.
    `fps`: frames per second.
    """
    (_write_mp4 if suffix == ".mp4" else _write_gif if suffix == ".gif" else _write_webp)(iter(frames), path, fps)


def _write_gif(frames: Iterator[Frame], path: Path, fps: float) -> None:
    from PIL import Image

    # One palette for all frames: with palettes of their own, flat areas would flicker.
    palette = _palette()
    shown = (Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    first = next(shown)
    with path.open("wb") as file:
        first.save(
            file, "GIF", save_all=True, append_images=shown, duration=round(1000.0 / true_rate(".gif", fps)), loop=0,
            disposal=1,
        )  # fmt: skip


def _palette() -> Any:
    """Return an image whose palette holds the colours of side views in shades towards white, and those of moments."""
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb
    from PIL import Image

    shades = np.linspace(0.0, 1.0, _SHADES, endpoint=False)[:, None]
    named = [(1.0 - shades) * np.array(to_rgb(name)) + shades for name in (*drawing.PALETTE, links.LOAD, links.GLOW)]
    moments = colormaps[drawing.COLORMAP](np.linspace(0.0, 1.0, _MOMENTS))[:, :3]
    image = Image.new("P", (1, 1))
    image.putpalette(np.round(255.0 * np.concatenate([np.ones((1, 3)), *named, moments])).astype(np.uint8).tobytes())
    return image


def _write_webp(frames: Iterator[Frame], path: Path, fps: float) -> None:
    from PIL import Image

    first = Image.fromarray(next(frames))
    others = (Image.fromarray(frame) for frame in frames)
    with path.open("wb") as file:
        first.save(
            file, "WEBP", save_all=True, append_images=others, duration=round(1000.0 / fps), loop=0, quality=80,
            method=2,
        )  # fmt: skip


def _write_mp4(frames: Iterator[Frame], path: Path, fps: float) -> None:
    first = _even(next(frames))
    writer = _ffmpeg().write_frames(
        str(path), first.shape[1::-1], fps=fps, codec="libx264", macro_block_size=2, quality=7,
        output_params=["-f", "mp4", "-movflags", "+faststart"],
    )  # fmt: skip
    writer.send(None)
    try:
        writer.send(np.ascontiguousarray(first))
        for frame in frames:
            writer.send(np.ascontiguousarray(_even(frame)))
    finally:
        writer.close()


def _even(frame: Frame) -> Frame:
    """Return a frame with even numbers of rows and columns, which the encoder needs."""
    return frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2]


def _ffmpeg() -> Any:
    try:
        return importlib.import_module("imageio_ffmpeg")
    except ImportError as error:
        raise MissingPackageError(
            f"animate: mp4 needs the package imageio-ffmpeg, which cannot be imported ({error}); install it with "
            "python -m pip install 'vofem[movie]', or choose a path that ends in .webp or .gif"
        ) from error
