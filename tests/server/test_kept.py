"""What is kept of what was made."""

from server.kept import Kept


def test_it_is_made_once_and_the_one_not_used_for_longest_makes_room() -> None:
    parts: Kept[str, str] = Kept(2)
    made: list[str] = []

    def make(name: str) -> str:
        made.append(name)
        return name

    for name in ("a", "b", "a", "c", "a", "b"):
        assert parts.kept(name, lambda name=name: make(name)) == name

    assert made == ["a", "b", "c", "b"]
