import os
import subprocess
import sys

import pytest

from hide_tasks.machine import fingerprint

SAY = "import server; from hide_tasks.machine import fingerprint; print(fingerprint()['blas'])"


def kernels(choice: str | None) -> str:
    environment = {key: value for key, value in os.environ.items() if key != "OPENBLAS_CORETYPE"}
    if choice is not None:
        environment["OPENBLAS_CORETYPE"] = choice
    done = subprocess.run([sys.executable, "-c", SAY], env=environment, capture_output=True)
    return done.stdout.decode().strip()


@pytest.mark.skipif(
    "avx2" not in fingerprint()["instructions"], reason="OpenBLAS has one kind of kernels here"
)
def test_every_processor_multiplies_alike_unless_its_user_chooses() -> None:
    assert kernels(None) == "openblas Haswell" == fingerprint()["blas"]
    assert kernels("Nehalem") == "openblas Nehalem"
