"""What goes wrong, as exceptions that fit into Python's own."""


class Error(Exception):
    """Whatever hemicube raises."""


class InputError(Error, ValueError):
    """What was given cannot be used; the message says what is needed."""


class StoreError(Error, ValueError):
    """What a store or a file holds cannot be used, or not for this."""


class FileError(Error, OSError):
    """The operating system refused."""


class MissingFileError(FileError, FileNotFoundError):
    """A file or directory is not there."""


class BackendError(Error, RuntimeError):
    """A backend failed, or is not there."""


# Tracebacks name them as users do: `hemicube.InputError`.
for _class in (Error, InputError, StoreError, FileError, MissingFileError, BackendError):
    _class.__module__ = "hemicube"
del _class
