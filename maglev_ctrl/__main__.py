"""`python -m maglev_ctrl` is the `maglev-ctrl` command."""

from maglev_ctrl.cli import command

if __name__ == "__main__":
    command()
