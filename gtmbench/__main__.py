"""``python -m gtmbench``."""

from gtmbench.cli.app import main

main()
