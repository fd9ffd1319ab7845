"""A white paper cup: thin and wide above, so that one in another hardly stands out."""

from dataclasses import dataclass, replace

from hide_tasks.assets.asset import Link
from hide_tasks.assets.cup import Cup
from hide_tasks.poses import Array


@dataclass
class PaperCup(Cup):
    """A place for a paper cup; it stands there, or it does not."""

    color: str = "white"
    foot: float = 0.011  # m
    rim: float = 0.036  # m
    height: float = 0.070  # m
    floor: float = 0.010  # m
    wall: float = 0.0015  # m
    mass: float = 0.05  # kg
    there: bool = True
    fixed: bool = False  # it stands fast on the table
    radius = 0.036

    def __post_init__(self) -> None:
        super().__post_init__()
        (link,) = self.links
        if self.fixed:
            self.links = (replace(link, mass=0.0, graspable=False),)
        if not self.there:
            unfelt = tuple(shape for shape in link.shapes if not shape.solid)
            self.links = (Link("no cup", unfelt),)

    def drawn(self, link: int) -> Array | None:
        """Where it is; None: no cup stands here."""
        return self.pose(link) if self.there else None

    def describe(self) -> dict[str, object]:
        """Also whether it is there."""
        return {**super().describe(), "there": self.there}
