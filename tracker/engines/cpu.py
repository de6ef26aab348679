"""What the processor can do, for choosing a precision and for reports."""

from __future__ import annotations

import platform
from pathlib import Path

CPUINFO = Path("/proc/cpuinfo")
BF16_FLAGS = frozenset({"avx512_bf16", "amx_bf16", "bf16"})  # x86 AVX-512, x86 AMX, Arm
SPEED_FLAGS = ("avx2", "avx512f", "avx512_bf16", "avx512_vnni", "amx_bf16", "amx_int8", "asimd", "bf16", "i8mm")


def _fields() -> dict[str, str]:
    try:
        text = CPUINFO.read_text()
    except OSError:
        return {}
    pairs = (line.split(":", 1) for line in text.splitlines() if ":" in line)
    return {key.strip(): value.strip() for key, value in pairs}


def cpu_flags() -> frozenset[str]:
    """Instruction-set flags as Linux names them; empty elsewhere."""
    fields = _fields()
    return frozenset((fields.get("flags") or fields.get("Features") or "").split())


def has_native_bf16() -> bool:
    """Whether bf16 multiplications are done by the processor and not emulated."""
    return bool(cpu_flags() & BF16_FLAGS)


def describe_cpu() -> str:
    """Model and the flags that matter for speed, in one line."""
    name = _fields().get("model name") or platform.processor() or platform.machine()
    flags = cpu_flags()
    return f"{name} ({' '.join(f for f in SPEED_FLAGS if f in flags) or 'no known vector flags'})"
