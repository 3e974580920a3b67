"""Values as JSON knows them."""

import math
from typing import Any


def json_values(value: Any) -> Any:
    """``value`` in types that JSON knows: arrays become lists, and what is not a finite number is None."""
    if isinstance(value, dict):
        return {str(key): json_values(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_values(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, known without importing NumPy
        return json_values(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, (bool, int, str, type(None))) else str(value)
