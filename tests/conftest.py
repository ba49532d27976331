"""Warnings are errors in the folders that are free of them; DeprecationWarning is that of other packages."""

from pathlib import Path

import pytest

# Folders and files whose tests raise no warning; the list only gets longer, until the setting is that of all tests.
WITHOUT_WARNINGS = ("asset", "compatibility", "core", "graph", "test_exr.py", "test_files.py", "test_limits.py",
                    "test_public_api.py", "test_rooms.py")  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Make warnings errors where there are none.

    Args:
        items: Collected tests.
    """
    here = Path(__file__).parent
    for item in items:
        if item.path.is_relative_to(here) and item.path.relative_to(here).parts[0] in WITHOUT_WARNINGS:
            # The last mark is applied first, so that the exception holds.
            item.add_marker(pytest.mark.filterwarnings("ignore::DeprecationWarning"))
            item.add_marker(pytest.mark.filterwarnings("error"), append=False)
