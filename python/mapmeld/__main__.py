"""`python -m mapmeld` is the command `mapmeld`."""

from mapmeld.cli import main

main()
