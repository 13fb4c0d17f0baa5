"""`resting_aspects studio`: a page in the browser for all questions about a part."""

import argparse
import asyncio
import sys
import threading
import webbrowser
from pathlib import Path

from resting_aspects_ros.errors import InvalidValueError

DESCRIPTION = """Open a page in the browser: drop a CAD file on it and see how the part lies.
The page is served by this computer, to this computer only, and needs no
network. Ctrl-C ends it."""
EXAMPLES = """examples:
  resting_aspects studio
  resting_aspects studio hex_nut
  resting_aspects studio bracket.step --port 8765 --no-browser
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'part',
        metavar='PART_OR_MESH',
        nargs='?',
        default='',
        help='name of a part, or a mesh file, that the page shows first',
    )
    parser.add_argument(
        '--port',
        metavar='N',
        type=int,
        default=0,
        help='port of the page on this computer (a free one)',
    )
    parser.add_argument(
        '--no-browser', action='store_true', help='print the address, and open no browser'
    )


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C; returns the exit code. Raises RestingAspectsError."""
    # Only what the first page needs: the modules that compute are imported while it is shown.
    from resting_aspects_ros.studio.page import examples
    from resting_aspects_ros.studio.server import Studio, serve
    from resting_aspects_ros.system import Interruption

    if not 0 <= arguments.port < 65536:
        raise InvalidValueError(f'invalid --port {arguments.port}: expected 0 to 65535')
    part = arguments.part
    if part and part not in examples() and not Path(part).is_file():
        raise InvalidValueError(
            f'invalid part {part!r}: expected a file or one of {", ".join(examples())}'
        )

    def ready(address: str) -> None:
        print(f'Studio: {address}', flush=True)
        print('Ctrl-C ends it.', file=sys.stderr)
        if not arguments.no_browser:
            # A browser in the terminal returns only when it ends, and needs the server meanwhile.
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    with Interruption() as stop:
        studio = Studio(part)
        try:
            asyncio.run(serve(studio, arguments.port, ready, lambda: stop.asked))
        except OSError as error:
            raise InvalidValueError(
                f'invalid --port {arguments.port}: expected a free port: {error.strerror}'
            ) from None
    return 0
