"""What of a machine can change the last bit of a simulation."""

import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_info

LIBRARIES = ("numpy", "numba", "pybullet")
DECISIVE = ("fma", "avx2", "avx512f")  # instruction sets that libm and numba choose between


def fingerprint() -> dict[str, str]:
    """Processor, instruction sets, kernels of linear algebra, C library and versions.

    Equal ones give equal state hashes.
    """
    facts = {
        "processor": _cpu_fact("model name") or platform.processor() or platform.machine(),
        "instructions": " ".join(_instructions()),
        "blas": _blas(),
        "libc": " ".join(platform.libc_ver()).strip() or platform.system(),
        "python": platform.python_version(),
    }
    return facts | {library: installed(library) or "missing" for library in LIBRARIES}


def installed(package: str) -> str | None:
    """The version of an installed package, without importing it."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@lru_cache(maxsize=1)
def _blas() -> str:
    """NumPy's linear algebra and the kernels that it chose when loaded: 'openblas Haswell'."""
    home = str(Path(np.__file__).parent)
    for library in threadpool_info():
        if library["user_api"] == "blas" and library["filepath"].startswith(home):
            return f"{library['internal_api']} {library.get('architecture', '')}".strip()
    return "unknown"


def _instructions() -> list[str]:
    flags = set(_cpu_fact("flags").split())
    return [name for name in DECISIVE if name in flags]


def _cpu_fact(name: str) -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return ""
    return next((line.partition(":")[2].strip() for line in lines if line.startswith(name)), "")
