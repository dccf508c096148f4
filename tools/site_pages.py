"""Collect the pages of the site in build/site-pages: those of docs/ and those that are made. `make docs` calls it."""

from __future__ import annotations

import shutil
from pathlib import Path

import gallery
import scene_reference

ROOT = Path(__file__).parent.parent
PAGES = ROOT / "build" / "site-pages"


def main() -> None:
    """Write the folder anew."""
    shutil.rmtree(PAGES, ignore_errors=True)
    shutil.copytree(ROOT / "docs", PAGES)
    gallery.write(PAGES)
    scene_reference.write(PAGES)


if __name__ == "__main__":
    main()
