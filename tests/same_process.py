"""Stands for a worker process where a test is not about the process: to start one takes longer than what it answers."""

from __future__ import annotations

from importlib import import_module

from lightwell.core.isolated import Arrays, WorkerError


class SameProcess:
    """Answers as ``lightwell.core.isolated.Worker`` does, without another process and its limits."""

    def __init__(self, function: str, seconds: float, memory: int) -> None:
        module, name = function.split(":")
        self.function = getattr(import_module(module), name)

    def __enter__(self) -> SameProcess:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def ask(self, request: Arrays, most_bytes: int) -> Arrays:
        """Answer a request; errors of the function are ``WorkerError``, as those that come from another process."""
        try:
            return self.function(request)
        except Exception as error:
            raise WorkerError(str(error)) from None
