"""Check for unknown properties of a lens: an unknown field raises an error that names the field."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

from farpoint.camera.files.fields import Fields

__all__ = [
    "LENS_WORDS",
    "is_nothing",
    "named_distortion",
    "names_lens_model",
    "refuse_contradiction",
    "refuse_others",
    "refuse_unread",
]

LENS_WORDS = re.compile(
    r".*(?:dist(?!ance)|coeff|fisheye|skew|polynom|projection|camera_?(?:model|type)|lens_?model).*"
    r"|[kpsb]_?\d+|tau_?[xy]|f_?[xy]?|c_?[xy]|xi|alpha|beta|gamma|omega|model|d|kc|lens.*",
    re.IGNORECASE,
)
"""Names of fields that look like a property of a lens."""

# Keys, in lower case without separators, of a property of a lens: with any value (first pattern),
# or with a single number or word as the value (second pattern).
_OF_A_LENS = re.compile(
    r".*(?:distort|distcoef|coef|fisheye|omnidir|skew|poly|division|lambda|radial|tangential|prism"
    r"|refract|anamorphic|squeeze|lens(?:fun|profile|param|corr)|undist|remap|lookup|binning|crop"
    r"|(?:lens|camera|projection|dist)(?:model|type)).*"
    r"|dist(?!ance).*|roi|regionofinterest|kc|warp|lut|(?:coef|param|dist).*order|order"
    r"|(?:pixel|sample).*aspect.*|(?:image|img|intrinsics?|resolution|digital)?(?:scale|zoom)(?:factor)?"
    r"|(?:resiz|decimat|down|upsampl|subsampl).*"
)
_OF_A_LENS_IF_ONE = re.compile(
    r"[a-dkprst]\d|[a-dw]|tau[xy]|xi|alpha|beta|gamma|omega|model|setup|orientation"
    r"|.*(?:rotat(?:e|ion)|flip|mirror|wideangle).*"
)
_OF_ITS_ERRORS = re.compile(r"fix.*|.*(?:std|dev|sigma|covar|error|uncert|rms|flags?$)")
_ONE_IS_NOTHING = re.compile(
    r".*(?:binning|scale|zoom|aspect|resiz|decimat|sampl|squeeze|factor).*"
)
_A_NAME = re.compile(
    r".*(?:name|label|title|descri|comment|note|path|file|topic|frame|id|url|serial)"
)
_LENS_MODEL_KEY = re.compile(
    r"fish.?eye|omnidir|kannala|equidistant|equirect|scaramuzza|double.?sphere|\bmei\b"
    r"|catadioptric|\bk1\W{1,3}k2\b",
    re.IGNORECASE,
)
"""Words that identify a text about a lens, under any key except the key of a name."""

_LONGEST = 200  # characters of a name or text that are compared
# Largest number of known fields that an error lists.
MOST_NAMED = 16
ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def refuse_others(
    fields: Fields, known: Collection[str], *, only: re.Pattern[str] | None = None
) -> None:
    """Raise an InputError about the first unknown field that is not empty.

    Parameters
    ----------
    fields : Fields
        The group that describes a camera.
    known : collection of str
        Keys that the reader of the format uses, or that are known to be no property of the lens.
    only : pattern, optional
        Check only keys that match this pattern, such as `LENS_WORDS` for a file with many fields
        that are not about a lens. By default every key is checked.
    """
    for key, value in fields.values.items():
        if key in known or is_nothing(value) or (only is not None and not only.fullmatch(key)):
            continue
        those = ", ".join(known) if len(known) <= MOST_NAMED else "those of the format"
        raise fields.error(key, f"is not understood; expected no field beside {those}")


def refuse_unread(fields: Fields, others: Collection[str] = ()) -> None:
    """Raise an InputError about a property of a lens that the reader of a file did not use.

    Parameters
    ----------
    fields : Fields
        The fields that were read, with their groups.
    others : collection of str
        Keys that belong to another camera.
    """
    for key, value in fields.values.items():
        if key in fields.groups:
            refuse_unread(fields.groups[key])
        elif key not in fields.read and key not in others and _is_of_a_lens(key, value):
            raise fields.error(
                key, "looks like a property of the lens, and is not understood in this place"
            )


def refuse_contradiction(fields: Fields, model: str, coefficients: str) -> None:
    """Raise an InputError if the file states that there is no distortion but has coefficients.

    Parameters
    ----------
    fields : Fields
        The group that describes a camera.
    model : str
        Key of the text that names the distortion model.
    coefficients : str
        Key of the coefficients, which may be absent or zero.
    """
    if fields.values.get(coefficients) is not None and any(fields.numbers(coefficients)):
        word = fields.text(model)
        raise fields.error(
            coefficients, f"expected zeros or no numbers beside {fields.place(model)}: {word}"
        )


def _is_of_a_lens(key: str, value: Any) -> bool:
    name = re.sub(r"[^a-z0-9]", "", str(key)[:_LONGEST].lower())
    if is_nothing(value) or _OF_ITS_ERRORS.fullmatch(name):
        return False
    if _ONE_IS_NOTHING.fullmatch(name) and str(value).strip() in ("1", "1.0", "1."):
        return False
    if names_lens_model(key, value):
        return True
    is_one = not isinstance(value, list | Mapping)
    return bool(_OF_A_LENS.fullmatch(name) or (is_one and _OF_A_LENS_IF_ONE.fullmatch(name)))


def names_lens_model(key: str, value: Any) -> bool:
    """Whether a text, or a text in a list, describes a lens and is not under the key of a name."""
    if _A_NAME.fullmatch(str(key)[:_LONGEST].lower()):
        return False
    texts = value if isinstance(value, list) else [value]
    return any(isinstance(text, str) and _LENS_MODEL_KEY.search(text[:_LONGEST]) for text in texts)


def named_distortion(fields: Fields) -> tuple[float, ...]:
    """OpenCV's coefficients under ``k1 k2 p1 p2 k3 k4 k5 k6``; a missing coefficient is zero.

    The result has 4, 5 or 8 numbers, or is empty if the file has none of these keys.
    """
    present = [index for index, key in enumerate(ORDER) if key in fields]
    if not present:
        return ()
    count = next(count for count in (4, 5, 8) if count > present[-1])
    return tuple(fields.number(key) if key in fields else 0.0 for key in ORDER[:count])


def is_nothing(value: Any) -> bool:
    """Whether a value is absent or zero, or a list or matrix of absent or zero values."""
    if isinstance(value, list):
        return all(is_nothing(item) for item in value)
    if isinstance(value, Mapping):
        return (
            is_nothing(value["data"]) if "data" in value else all(map(is_nothing, value.values()))
        )
    if value is None or str(value).strip().lower() in ("", "null", "~", "none", "false"):
        return True
    try:
        return float(value) == 0.0
    except (TypeError, ValueError):
        return False
