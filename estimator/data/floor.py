"""Prior knowledge of the floor, before a clip is used."""

from __future__ import annotations

from typing import Literal

OFF: Literal["off"] = "off"
KnownFloor = float | Literal["off"] | None
"""Its height in the world, z up [m]; "off" where there is none; None where it is to be found from the person's feet."""
