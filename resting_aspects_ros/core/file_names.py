"""Names of files, which on Linux are any bytes, where text is wanted."""


def printable(name: str) -> str:
    r"""The name as text that every stream and every ROS message takes: '\udcff' for a byte 255."""
    return name.encode('utf-8', 'backslashreplace').decode('utf-8')


def is_printable(name: str) -> bool:
    """Whether a name is UTF-8 as it is."""
    return printable(name) == name
