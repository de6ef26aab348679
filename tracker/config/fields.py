"""Building blocks of a schema: a section that knows its keys, a number that knows its range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema


class Section(BaseModel):
    """A mapping of the file: unknown keys are errors, nothing can be changed afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True)


@dataclass(frozen=True, slots=True)
class Bounds:
    """A finite number from `low` to `high`, both included; `whole`: an integer. Text and true/false are no numbers."""

    low: float
    high: float
    whole: bool = False

    def check(self, value: object) -> int | float:
        """The number itself. Raises PydanticCustomError naming value and range."""
        kind = "a whole number" if self.whole else "a number"
        span = f"must be {kind} from {self.low:g} to {self.high:g}"
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise PydanticCustomError("not_a_number", "{value}: {span}", {"value": repr(value), "span": span})
        # NaN fails the comparison too, and an integer too large for a float can still be compared.
        if not self.low <= value <= self.high or (self.whole and value != int(value)):
            raise PydanticCustomError("out_of_range", "{value}: {span}", {"value": _shown(value), "span": span})
        return int(value) if self.whole else float(value)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self.check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        described = handler(schema)
        described.update(minimum=self.low, maximum=self.high)
        return described


def _shown(value: int | float) -> str:
    return f"{value:g}" if abs(value) < 1e15 or isinstance(value, float) else "an integer of many digits"
