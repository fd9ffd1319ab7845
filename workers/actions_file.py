"""The actions of one episode as a file, which `hide eval replay:FILE.json` plays again."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from hide_tasks.contract import Action, Rules, Split

ACTIONS_SUFFIX = ".json"


class EpisodeActions(BaseModel):
    """Everything that was asked of the arm in an episode, and what it came to."""

    model_config = ConfigDict(extra="ignore")

    suite: str  # e.g. "hide 1"
    task: str
    split: Split
    index: int
    rules: Rules
    policy: str  # whose they are
    scene_hash: str | None  # a replay has the same, and on a machine of the same kind
    final_state_hash: str | None  # this one as well
    actions: list[Action]


class ActionsError(ValueError):
    """The file holds no actions; the message says why."""


def read(path: Path) -> EpisodeActions:
    """The actions in a file.

    Raises:
        ActionsError: there is none, or it holds something else.
    """
    try:
        return EpisodeActions.model_validate_json(path.read_bytes())
    except OSError as error:
        raise ActionsError(f"{path} cannot be read: {error.strerror}.") from None
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise ActionsError(f"{path} holds no actions: {where} {fault['msg']}.") from None
