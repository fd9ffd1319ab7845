"""Which kernels NumPy multiplies with: the same on every processor, where there is a choice."""

import os
from pathlib import Path

VARIABLE = "OPENBLAS_CORETYPE"
CORE = "Haswell"  # OpenBLAS's kernels for AVX2, which processors of other makers run as well


def settle_kernels() -> None:
    """NumPy loaded from now on, here and in processes below, multiplies alike on any x86 with AVX2.

    OpenBLAS would choose by processor, and the last bit with it: with its kernels for AVX-512 some
    episodes of search_boxes and stack_blocks end in another state. What the user chose stays.
    """
    try:
        processor = Path("/proc/cpuinfo").read_text()
    except OSError:
        return  # not Linux: wheels of NumPy for macOS know no such variable
    if " avx2" in processor:
        os.environ.setdefault(VARIABLE, CORE)
