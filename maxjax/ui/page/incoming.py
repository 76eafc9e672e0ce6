"""Messages from a browser: of the kinds that a page has, each value of its control's kind and within its range.

viser casts, keeps and sends on what it is told; a slider with an empty list for a value breaks every browser that comes
later. So each message is judged before viser reads it: it passes, or is dropped with one line.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

MOST_BYTES = 2**20
"""Of one message."""

_FAR = 1e6  # of places on a page, which count from the map's middle [m]
_HUGE = 1e9  # of any number
_LONGEST = 1000  # characters of a text that is typed
_Check = Callable[[Any], bool]


def fault_of(content: bytes | str, controls: Mapping[str, Any]) -> str:
    """The fault of a message, in words; empty for a valid one.

    Args:
        content: as it was received.
        controls: viser's handles of the panel, by their ids.
    """
    message = _decoded(content)
    if message is None:
        return "is no message"
    kind = message.pop("type", None)
    fields = _FIELDS.get(kind) if isinstance(kind, str) else None
    if fields is None:
        return f"is of the kind {_shown(kind)}, which the page has not"
    missing = fields.keys() - message.keys() - {"owner"}
    if missing or message.keys() - fields.keys():
        return f"of the kind {kind} has not the fields of one"
    for name, value in message.items():
        if not fields[name](value):
            return f"of the kind {kind} has {name} {_shown(value)}"
    return _fault_of_update(message["uuid"], message["updates"], controls) if kind == "GuiUpdateMessage" else ""


def refusal_of(content: bytes | str, controls: Mapping[str, Any]) -> str:
    """The message for a user whose control has a value that is refused; empty where there is none.

    Args:
        content: as it was received.
        controls: viser's handles of the panel, by their ids.
    """
    message = _decoded(content) or {}
    updates = message.get("updates")
    uuid = message.get("uuid")
    control = controls.get(uuid) if message.get("type") == "GuiUpdateMessage" and isinstance(uuid, str) else None
    if control is None or not isinstance(updates, dict) or updates.keys() != {"value"}:
        return ""
    held, props = control._impl.value, control._impl.props
    if _fits(updates["value"], held, props):
        return ""
    low, high = getattr(props, "min", None), getattr(props, "max", None)
    what = "a text" if isinstance(held, str) else "a number" if isinstance(held, (int, float)) else "such a value"
    within = f" from {low:g} to {high:g}" if low is not None and high is not None else ""
    label = getattr(props, "label", None) or "This control"
    return f"{label}: expected {what}{within}, given {_shown(updates['value'])}; {_shown(held)} stays"


def _decoded(content: bytes | str) -> dict[str, Any] | None:
    import msgspec

    if isinstance(content, str):
        return None
    try:
        message: dict[str, Any] = msgspec.msgpack.decode(content, type=dict[str, Any])
    except (msgspec.MsgspecError, RecursionError, ValueError, TypeError):
        return None
    return message


def _fault_of_update(uuid: str, updates: dict[Any, Any], controls: Mapping[str, Any]) -> str:
    if updates.keys() != {"value"}:
        return f"changes {_shown(sorted(map(str, updates)))} of a control, expected its value"
    control = controls.get(uuid)
    # One that was removed in the meantime is no fault; viser drops it.
    if control is None or _fits(updates["value"], control._impl.value, control._impl.props):
        return ""
    return f"has {_shown(updates['value'])} for a control that holds {_shown(control._impl.value)}"


def _fits(value: Any, held: Any, props: Any) -> bool:
    """Whether a value is of the kind of the one that a control holds, and within its range or options."""
    match held:
        case bool():
            return isinstance(value, bool)
        case int() | float():
            return _number(value) and _within(value, props)
        case str():
            options = getattr(props, "options", None)
            return _text(value) and (options is None or value in options)
        case tuple():
            numbers = _numbers(len(held))(value)
            return numbers and list(value) == sorted(value) and all(_within(one, props) for one in value)
    return False


def _within(value: float | int, props: Any) -> bool:
    """Within a control's range, but for a step, since a browser rounds to steps."""
    low, high, step = (getattr(props, name, None) for name in ("min", "max", "step"))
    room = step or 0.0
    return (low is None or value >= low - room) and (high is None or value <= high + room)


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= _HUGE  # NaN is not


def _numbers(count: int) -> _Check:
    return lambda value: isinstance(value, (list, tuple)) and len(value) == count and all(map(_number, value))


def _place(value: Any) -> bool:
    return _numbers(3)(value) and max(map(abs, value)) <= _FAR


def _text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST


def _direction(value: Any) -> bool:
    return _numbers(3)(value) and 0.5 < math.hypot(*value) < 2.0


def _rotation(value: Any) -> bool:
    return _numbers(4)(value) and 0.5 < math.hypot(*value) < 2.0


def _size(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**16


def _pointer(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and len(value) == 1 and _numbers(2)(value[0])


_NAMED: dict[str, _Check] = {"name": _text, "owner": _text}
_FIELDS: dict[str, dict[str, _Check]] = {
    "GuiUpdateMessage": {"uuid": _text, "updates": lambda value: isinstance(value, dict)},
    "ViewerCameraMessage": {
        "wxyz": _rotation,
        "position": _place,
        "fov": _number,
        "near": _number,
        "far": _number,
        "image_height": _size,
        "image_width": _size,
        "look_at": _place,
        "up_direction": _numbers(3),
    },
    "TransformControlsUpdateMessage": {**_NAMED, "wxyz": _rotation, "position": _place},
    "TransformControlsDragStartMessage": _NAMED,
    "TransformControlsDragEndMessage": _NAMED,
    "ScenePointerMessage": {
        "event_type": lambda value: value == "click",
        "ray_origin": _place,
        "ray_direction": _direction,
        "screen_pos": _pointer,
        "modifier": lambda value: value is None or _text(value),
    },
}


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]} …"
