"""Kinds of options that several commands share."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

Files = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]
Flag = Annotated[bool, Parameter(negative="")]
