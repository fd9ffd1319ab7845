"""What the page of a comparison is asked for, and how it stands in the address."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import Query

from hide_tasks.contract import Category
from hide_tasks.suite import SUITE
from server.schemas.common import Verdict
from server.schemas.several import SeveralComparison, SeveralEpisode
from server.suites import Place
from web.episode_grid import LETTERS
from web.filters import EMPTY_IS_NONE
from web.templating import query

MOST_TYPED = 20  # fields of the form; more than can be compared, so that it can say so
WHICH = "^(all|differ|every|none|only_[a-f]|lacks_[a-f])$"

Typed = Annotated[list[Annotated[str, Query(max_length=200)]], Query(max_length=MOST_TYPED)]
Side = Annotated[str, Query(max_length=200)]
Which = Annotated[str, Query(pattern=WHICH)]
OneCategory = Annotated[Category | None, Query(), EMPTY_IS_NONE]
OneTask = Annotated[str, Query(max_length=80)]


@dataclass(frozen=True)
class Asked:
    """A comparison as it is asked for."""

    policies: list[str]
    suite: str = SUITE
    split: str = "test"
    verdict: Verdict = "success"
    category: Category | None = None
    which: str = "all"
    task: str = ""

    @property
    def place(self) -> Place:
        """Where policies' names are looked up."""
        return Place(self.suite, self.split)

    def address(self, **changed: Any) -> str:
        """Where the page stands, with something else instead; defaults are left out."""
        fields = {**vars(self), **changed}
        given = {name: fields[name] for name, usual in DEFAULTS.items() if fields[name] != usual}
        return f"/comparisons{query(policy=fields['policies'], **given)}"

    def without(self, place: int) -> str:
        """The same comparison with one policy less."""
        left = [one for at, one in enumerate(self.policies) if at != place]
        return self.address(policies=left, which="all")

    def with_(self, name: str) -> str:
        """The same comparison with one policy more."""
        return self.address(policies=[*self.policies, name])

    def export(self, format: str) -> str:
        """The comparison as a file."""
        of = {**self.place._asdict(), "verdict": self.verdict, "format": format}
        return f"/api/v1/comparisons/several/export{query(policy=self.policies, **of)}"

    @property
    def shows(self) -> Callable[[SeveralEpisode], bool]:
        """True of the episodes that are asked for by who managed them."""
        kind, _, letter = self.which.partition("_")
        place = LETTERS.lower().find(letter) if letter else -1
        return lambda one: _fits(kind, place, one.managed)

    def listed(self, found: SeveralComparison) -> list[SeveralEpisode]:
        """The episodes that are asked for by category, task, and who managed them."""
        return [
            one
            for one in found.episodes
            if self.category in (None, one.category)
            and self.task in ("", one.task)
            and self.shows(one)
        ]


DEFAULTS: dict[str, Any] = {
    "suite": SUITE,
    "split": "test",
    "verdict": "success",
    "category": None,
    "which": "all",
    "task": "",
}


def _fits(kind: str, place: int, managed: Sequence[bool]) -> bool:
    if kind in ("only", "lacks"):
        alone = kind == "only"
        return place < len(managed) and all(
            good == ((at == place) == alone) for at, good in enumerate(managed)
        )
    return {
        "all": True,
        "differ": len(set(managed)) > 1,
        "every": all(managed),
        "none": not any(managed),
    }[kind]


def choices(count: int) -> list[tuple[str, str]]:
    """The values of `which` for as many policies, and what they are called."""
    everybody, nobody = ("both", "neither") if count == 2 else ("all", "none")
    found = [
        ("all", "all episodes"),
        ("differ", "where they differ"),
        ("every", f"{everybody} managed"),
        ("none", f"{nobody} managed"),
    ]
    found += [(f"only_{one.lower()}", f"only {one} managed") for one in LETTERS[:count]]
    if count > 2:
        found += [(f"lacks_{one.lower()}", f"only {one} failed") for one in LETTERS[:count]]
    return found
