"""Parts of pages that are kept."""

from markupsafe import Markup

from web.templating import KeptParts


def test_a_part_is_made_once_and_the_one_not_used_for_longest_makes_room() -> None:
    parts, made = KeptParts(2), []

    def make(name: str) -> Markup:
        made.append(name)
        return Markup(name)

    for name in ("a", "b", "a", "c", "a", "b"):
        assert parts.kept(name, lambda name=name: make(name)) == name

    assert made == ["a", "b", "c", "b"]
