"""`python -m linecarve`: the program."""

from ._cli import main

main()
