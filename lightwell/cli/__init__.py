"""The command line. A verb is a module: its arguments (``add``) and its call (``run``); see ``main.VERBS``."""

from lightwell.cli.main import main as main
