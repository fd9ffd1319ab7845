"""The trained checkpoints that come with the code, as policies that belong to the server itself."""

import logging
from pathlib import Path

from sqlalchemy.orm import Session

from seek_model import trained
from seek_model.checkpoint_header import BadCheckpoint
from seek_model.trained import Trained
from server import checkpoints, policies
from server.blobs import Blobs
from server.checkpoints import Received

logger = logging.getLogger(__name__)


def register_trained(session: Session, store: Blobs, folder: Path) -> None:
    """Makes sure that the checkpoints of a folder are there; another file is the next version.

    One that cannot be read, or whose name somebody took before there was one, is left out.
    """
    for name in trained.there(folder):
        try:
            one = trained.read(name, folder)
            if name in policies.reserved(session):
                _register(session, store, one)
            else:
                logger.warning("'%s' is a user's policy here; %s is left out", name, one.path)
        except (BadCheckpoint, OSError) as error:
            logger.warning("The trained policy %s is left out: %s", name, error)


def _register(session: Session, store: Blobs, one: Trained) -> None:
    if not store.holds(one.sha256) and store.put(one.path.read_bytes()) != one.sha256:
        raise BadCheckpoint(f"{one.path} changed while it was read")
    if checkpoints.known(session, one.name, one.sha256) is None:
        received = Received(one.path, one.sha256, one.size)
        checkpoints.keep(
            session,
            received,
            name=one.name,
            description=trained.ABOUT[one.name],
            config=one.header.config,
            suite=one.header.provenance.suite,
        )
