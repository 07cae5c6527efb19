"""Base of every record a scenario file is made of, and the names in it."""

from __future__ import annotations

from typing import Annotated, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=40)]
"""A name other parts of the file and the report refer to: lower-case letters, digits and underscores."""

Item = TypeVar("Item")
Many = Annotated[tuple[Item, ...], Field(strict=False)]
"""A list in the file, a tuple in the record."""


class Record(BaseModel):
    """A frozen record that refuses unknown keys and never guesses a type.

    `later_keys`: fields that came after the format's first version; left out, they leave a file's hash as it was.
    """

    later_keys: ClassVar[frozenset[str]] = frozenset()

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False, validate_by_name=False)
