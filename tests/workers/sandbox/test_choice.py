import pytest

from workers.sandbox import bubblewrap, choice
from workers.sandbox.choice import CHOICE, NoSandbox, Sandbox, best, chosen, offer, offers


def test_no_sandbox_can_be_had_everywhere_and_the_best_is_one_that_can() -> None:
    assert [one.sandbox for one in offers()] == list(Sandbox)
    assert not offer(Sandbox.NONE).missing
    assert not offer(best()).missing


def test_a_name_the_environment_and_the_best_are_taken_in_this_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(CHOICE, raising=False)
    assert chosen() == chosen("best") == best()

    monkeypatch.setenv(CHOICE, "none")

    assert (chosen(), chosen("best")) == (Sandbox.NONE, best())


def test_an_unknown_name_is_told_what_there_is() -> None:
    with pytest.raises(NoSandbox, match="No sandbox 'docker'; there are best, bubblewrap, "):
        chosen("docker")


def test_what_is_not_installed_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert bubblewrap.program() is None
    choice.offer.cache_clear()
    try:
        with pytest.raises(NoSandbox, match=r"bwrap is not installed .* There are .*none"):
            chosen("bubblewrap")
    finally:
        choice.offer.cache_clear()
