import pytest

from workers.sandbox.limits import GIB, MEMORY, Limits


def test_the_environment_grants_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(MEMORY, "1.5")

    assert Limits.of_environment() == Limits(memory=3 * GIB // 2)


@pytest.mark.parametrize("granted", ["much", "0", "-1", "nan", "inf"])
def test_what_is_no_amount_is_refused(monkeypatch: pytest.MonkeyPatch, granted: str) -> None:
    monkeypatch.setenv(MEMORY, granted)

    with pytest.raises(ValueError, match=f"{MEMORY}={granted}: expected a number of GiB"):
        Limits.of_environment()
