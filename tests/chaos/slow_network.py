"""`hide serve` behind a network that a test slows down: python -m tests.chaos.slow_network serve …

A file in the folder HOLDS holds back the next report of its kind: `start.asked` before the server
hears of it, `start.answered` before the worker hears the answer. It is called `start.asked.here`
meanwhile, until it is removed. `result.twice` stays, and repeats every result.
"""

import asyncio
import os
import sys
from pathlib import Path
from typing import Any

HOLDS = "HIDE_TEST_HOLDS"
LATE = "late"  # a file: what was held back before the server heard of it has come
EVERY = 0.02  # s


class SlowNetwork:
    """ASGI: everything reaches the application, some of it late or twice."""

    def __init__(self, app: Any, holds: Path):
        self.app, self.holds = app, holds

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http" or not scope["path"].startswith("/internal/"):
            await self.app(scope, receive, send)
            return
        what = scope["path"].rpartition("/")[2]
        if what == "result":
            receive = await self._whole(scope, receive)

        async def answer(message: Any) -> None:
            if message["type"] == "http.response.start":
                await self._held(f"{what}.answered")
            await send(message)

        late = await self._held(f"{what}.asked")
        await self.app(scope, receive, answer)
        if late:
            (self.holds / LATE).touch()

    async def _whole(self, scope: Any, receive: Any) -> Any:
        """A way to hear a request from the start, whatever became of its sender."""
        messages = [await receive()]
        while messages[-1].get("more_body"):
            messages.append(await receive())

        def again() -> Any:
            left = list(messages)

            async def hear() -> Any:
                return left.pop(0) if left else await receive()

            return hear

        async def nobody(_: Any) -> None: ...

        if (self.holds / "result.twice").exists():
            await self.app(dict(scope), again(), nobody)
        return again()

    async def _held(self, name: str) -> bool:
        """Waits where a test wants it, once; whether it did."""
        held = self.holds / f"{name}.here"
        try:
            (self.holds / name).rename(held)
        except FileNotFoundError:
            return False
        while held.exists():
            await asyncio.sleep(EVERY)
        return True


def main() -> None:
    """The command `hide`, whose server is behind this network."""
    import web.app
    from server import cli

    made = web.app.create_app

    def create_app(settings: Any) -> Any:
        app = made(settings)
        app.add_middleware(SlowNetwork, holds=Path(os.environ[HOLDS]))
        return app

    web.app.create_app = create_app
    cli.main(sys.argv[1:])


if __name__ == "__main__":
    main()
