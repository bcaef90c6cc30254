"""`nearfar list`."""

from rich.console import Console

from nearfar.exports import EXPORTERS
from nearfar.registry import DESCRIPTORS, ESTIMATORS, METHODS, PROPOSERS


def list_command() -> None:
    """Name all methods, proposers, descriptors, estimators and export formats."""
    console = Console(emoji=False, highlight=False)
    for registry in (METHODS, PROPOSERS, DESCRIPTORS, ESTIMATORS, EXPORTERS):
        console.print(f"[bold]{registry.kind}s[/bold]")
        for name in registry.names():
            console.print(f"  {name}", markup=False)
