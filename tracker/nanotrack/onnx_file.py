"""Lets an ONNX network take pictures of any size, without the `onnx` package.

The published backbone is exported for one size of picture, though nothing in it depends on the size, and it is needed
for two: exemplar and search crop. ONNX Runtime refuses other sizes than the file declares. So the declarations are
taken out of the file's bytes, which are protocol buffers (onnx/onnx.proto).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

# Numbers of the fields on the way from ModelProto to the sizes (onnx.proto).
GRAPH = 7
GRAPH_INPUT, GRAPH_OUTPUT, GRAPH_VALUE_INFO = 11, 12, 13
VALUE_TYPE, TENSOR_TYPE, TENSOR_SHAPE, SHAPE_DIM = 2, 1, 2, 1

HEIGHT_AXIS = 2  # of (batch, channels, height, width)
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5  # wire types
MAX_VARINT_BYTES = 10

Change = Callable[[bytes], "bytes | None"]  # None: leave the field out


def free_picture_size(model: bytes) -> bytes:
    """The same network with undeclared height and width. Raises ValueError when these are no protocol buffers."""
    value = _inside(VALUE_TYPE, _inside(TENSOR_TYPE, _inside(TENSOR_SHAPE, _free_shape)))
    changes = {GRAPH_INPUT: value, GRAPH_OUTPUT: value, GRAPH_VALUE_INFO: _drop}
    return _changed(model, {GRAPH: lambda graph: _changed(graph, changes)})


def _drop(_: bytes) -> None:
    """Sizes between the layers: ONNX Runtime works them out again."""


def _inside(field: int, change: Change) -> Change:
    return lambda message: _changed(message, {field: change})


def _free_shape(shape: bytes) -> bytes:
    axis = -1

    def free(dim: bytes) -> bytes:
        nonlocal axis
        axis += 1
        return dim if axis < HEIGHT_AXIS else b""

    return _changed(shape, {SHAPE_DIM: free})


def _changed(message: bytes, changes: dict[int, Change]) -> bytes:
    out = bytearray()
    for number, raw, payload in _fields(message):
        change = changes.get(number)
        if change is None or payload is None:
            out += raw
            continue
        new = change(payload)
        if new is not None:
            out += _varint(number << 3 | BYTES) + _varint(len(new)) + new
    return bytes(out)


def _fields(message: bytes) -> Iterator[tuple[int, bytes, bytes | None]]:
    """Number, all bytes and, where the field holds bytes, these."""
    at = 0
    while at < len(message):
        start = at
        key, at = _read_varint(message, at)
        wire, payload = key & 7, None
        if wire == VARINT:
            _, at = _read_varint(message, at)
        elif wire == BYTES:
            length, at = _read_varint(message, at)
            payload, at = message[at : at + length], at + length
        elif wire in (FIXED32, FIXED64):
            at += 4 if wire == FIXED32 else 8
        else:
            raise ValueError(f"byte {start} begins a field of unknown kind {wire}")
        if at > len(message):
            raise ValueError("the last field is cut off")
        yield key >> 3, message[start:at], payload


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    for place in range(MAX_VARINT_BYTES):
        if at + place >= len(data):
            raise ValueError("the last field is cut off")
        byte = data[at + place]
        value |= (byte & 0x7F) << 7 * place
        if byte < 0x80:
            return value, at + place + 1
    raise ValueError(f"byte {at} begins a number without an end")


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
