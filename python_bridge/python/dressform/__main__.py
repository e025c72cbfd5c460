"""`python -m dressform` is the command line."""

from .cli import main

main()
