"""A process that makes pictures or tiles, and the tasks that wait for it."""

import asyncio
from pathlib import Path

from nearfar.app.errors import BusyError
from nearfar.app.process import Ended, Message, WorkerProcess


class Lane:
    """Gives tasks to a process, one after the other; one that takes too long ends the process.

    Args:
        program: module that the process runs.
        most: largest number of tasks that wait or are under way.
        seconds: longest time of a task.
    """

    def __init__(self, program: str, most: int, seconds: float) -> None:
        self.worker = WorkerProcess(program)
        self._most = most
        self._seconds = seconds
        self._under_way = 0
        self._lock = asyncio.Lock()

    async def do(self, task: Message, file: Path) -> Ended:
        """Do a task; what takes too long is an error in what is returned.

        Args:
            task: a task that the program of the process takes.
            file: its image, which an error names.

        Raises:
            BusyError: too many tasks wait.
        """
        if self._under_way >= self._most:
            raise BusyError("too many large images at a time: try again")
        self._under_way += 1
        try:
            async with self._lock, asyncio.timeout(self._seconds):
                return await self.worker.do(task)
        except TimeoutError:
            return Ended(
                error=f"{file} cannot be read within {self._seconds:.0f} seconds: reduce it"
            )
        finally:
            self._under_way -= 1
