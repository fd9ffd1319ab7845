"""What the parts of a running server share: its ledger, its files, its engine."""

import asyncio
import logging
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial

from server import cluster, credentials, evaluations, first_run, jobs, lifecycle, policies, users
from server.access import Principal, Role
from server.bell import Bell
from server.blobs import Blobs
from server.data_folder import DataFolder
from server.db import Database
from server.deliverer import Deliverer
from server.growing import GrowingRecordings
from server.metrics import Metrics
from server.reconciler import Reconciler
from server.retention import Retention, Rule
from server.settings import EVERY_ADDRESS, Settings
from server.trained_policies import register_trained
from server.uploads import Uploads
from workers.engines.engine import Engine
from workers.engines.membership import Membership
from workers.policies import Surroundings
from workers.sandbox.choice import Sandbox, chosen

logger = logging.getLogger(__name__)
WORKERS_LOG = "workers.log"
RESERVE = 500 * 2**20  # bytes of disk below which nothing more is handed out
TRIALS = 2  # of policies' servers at a time


@dataclass
class Hub:
    """A server's parts. Made by `opened`, started and stopped by the application."""

    settings: Settings
    folder: DataFolder
    database: Database
    owner_id: str
    bell: Bell = field(default_factory=Bell)
    engine: Engine | None = None
    reconciler: Reconciler | None = None

    @classmethod
    def opened(cls, settings: Settings) -> "Hub":
        """A hub that holds the data folder, with the ledger up to date.

        Raises:
            DataFolderError, LedgerError: the folder or its ledger cannot be used.
        """
        folder = DataFolder(settings.data)
        try:
            database = Database(settings.ledger if settings.database else folder.ledger)
        except BaseException:
            folder.close()
            raise
        try:
            database.claim()
            with database.writing() as session:
                owner = users.register_owner(session).id
        except BaseException:
            database.close()
            folder.close()
            raise
        hub = cls(settings, folder, database, owner)
        hub.database.after_commit = hub.bell.ring
        return hub

    def __post_init__(self) -> None:
        self.blobs = Blobs(self.folder.blobs)
        self.uploads = Uploads(self.folder.uploads)
        self.recordings = GrowingRecordings(self.folder.growing)
        self.deliverer = Deliverer(self.database, self.bell, self.settings.allow_webhook)
        self.owner = Principal(
            self.owner_id, users.OWNER, Role.ADMIN, Role.ADMIN.scopes, via="local"
        )
        self.local_token = (
            credentials.written(credentials.LOCAL, credentials.new_secret())
            if self.settings.asks_token
            else None
        )
        self.metrics = Metrics(self)
        rule = Rule(self.settings.keep_days, self.settings.keep_bytes)
        self.retention = Retention(self.database, self.blobs, rule)
        scheduler = self.settings.scheduler
        self.membership = cluster.membership(self.folder.path, scheduler) if scheduler else None
        self.loading = asyncio.Lock()  # of a checkpoint: one takes much memory
        self.trying = asyncio.Semaphore(TRIALS)  # of policies' servers, each a process that waits

    @property
    def address(self) -> str:
        """Where workers of this machine reach the server."""
        local = ("localhost", *EVERY_ADDRESS)
        host = "127.0.0.1" if self.settings.host in local else self.settings.host
        return f"http://{f'[{host}]' if ':' in host else host}:{self.settings.port}"

    @property
    def entrance(self) -> str:
        """The address that people open; in local mode with the token, if one is asked for."""
        address = self.settings.public_url or self.address
        return f"{address}/login?token={self.local_token}" if self.local_token else address

    @cached_property
    def sandbox(self) -> Sandbox:
        """What is around the processes of policies on this machine.

        Raises:
            NoSandbox: the one that the settings ask for cannot be had.
        """
        return chosen(self.settings.sandbox)

    def surroundings(self, timeout: float = Surroundings.timeout) -> Surroundings:
        """For a policy's process that the server starts itself, to try a policy."""
        return Surroundings(timeout, sandbox=self.sandbox, hidden=(self.folder.path.absolute(),))

    def start(self) -> None:
        """Takes up what was left, and begins to hand out work; the event loop is running."""
        self.bell.attach()
        self.recordings.clear()
        self.blobs.clear_parts()
        with self.database.writing() as session:
            policies.register_builtin(session)
            register_trained(session, self.blobs, self.settings.trained)
            self.uploads.sweep(session)
            lifecycle.recover(session, evaluations.current_sources())
            if self.settings.auth == "users" and not users.somebody(session):
                logger.warning("Nobody may sign in yet: hide user add NAME --role admin")
            if self.settings.references:
                first_run.evaluate_own(session)
        self.deliverer.start()
        self.retention.start()
        if self.membership:
            self._start_cluster(self.membership)
        elif self.settings.workers:
            self._start_workers(self.settings.workers)

    def _start_workers(self, count: int) -> None:
        from workers.engines.local import LocalEngine
        from workers.supervisor import run_shard

        engine = LocalEngine(
            run_shard,
            workers=count,
            log=self.folder.logs / WORKERS_LOG,
            on_ended=self.bell.reconciler.set,
        )
        self._reconcile(engine, lambda: count, sandbox=self.sandbox)

    def _start_cluster(self, membership: Membership) -> None:
        from workers.engines.dask import DaskEngine
        from workers.engines.member import play

        engine = DaskEngine(
            play,
            scheduler=membership.scheduler,
            security=membership.security(),
            encode=lambda job: job.model_dump(mode="json"),
            on_ended=self.bell.reconciler.set,
        )
        self._reconcile(engine, engine.slots, sandbox=None)

    def _reconcile(
        self, engine: Engine, slots: Callable[[], int], *, sandbox: Sandbox | None
    ) -> None:
        self.engine = engine
        self.reconciler = Reconciler(
            self.database,
            engine,
            self.recordings,
            self.bell,
            slots=slots,
            draft=partial(
                jobs.draft,
                store=self.blobs,
                server=self.address,
                episode_limit=self.settings.episode_limit,
                allow_python=self.settings.allow_python,
                sandbox=sandbox,
                hidden=(self.folder.path.absolute(),),
                allow_remote=self.settings.allow_remote,
            ),
            may_hand_out=self.has_room,
        )
        self.reconciler.start()

    def has_room(self, more: int = 0) -> bool:
        """True while the disk has room for what is measured, and for so many bytes more."""
        return shutil.disk_usage(self.folder.path).free - more > RESERVE

    def stop(self) -> None:
        """Stops workers and lets go of the data folder; nothing that is final is lost."""
        self.bell.close()
        self.deliverer.stop()
        self.retention.stop()
        if self.reconciler:
            self.reconciler.stop()
        if self.engine:
            self.engine.close()
        self.database.close()
        self.folder.close()
