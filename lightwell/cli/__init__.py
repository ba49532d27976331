"""The command line. Each verb is a module with its arguments (``add``) and its call (``run``); see ``main.VERBS``."""

from lightwell.cli.main import main as main
