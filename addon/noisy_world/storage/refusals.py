# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns a store's exceptions into one line with the address and the remedy."""

import contextlib
import sys
from collections.abc import Iterator

from ..core.datasets.storage import FULL
from ..core.errors import MissingDependencyError, StorageError
from ..core.extras import install_command, pip_command

IN_EXTRA = ("fsspec", "s3fs", "pyarrow")
AGAIN = "the same command goes on from here"

# The errors of the libraries that fsspec's file systems are made of, by the module that has them. They are looked up
# where the module is loaded: a library that nobody loaded raises nothing.
_LIBRARIES = {
    "botocore.exceptions": ("BotoCoreError", "ClientError"),
    "aiohttp": ("ClientError",),
    "google.auth.exceptions": ("GoogleAuthError",),
    "gcsfs.retry": ("HttpError",),
    "azure.core.exceptions": ("AzureError",),
}


def store_errors() -> tuple[type[Exception], ...]:
    """Return the exceptions by which a store says no, of the libraries that are loaded."""
    found: list[type[Exception]] = [OSError, NotImplementedError]  # the second: fsspec's stores that are only read
    for module, names in _LIBRARIES.items():
        if module in sys.modules:
            found += [getattr(sys.modules[module], name) for name in names]
    return tuple(found)


@contextlib.contextmanager
def refusals_as_errors(address: str, doing: str) -> Iterator[None]:
    """Turn a store's refusal into one line. doing: "read" or "written"."""
    try:
        yield
    except store_errors() as error:  # an expression: it is evaluated once something is raised, with what is loaded then
        raise refusal(address, doing, error) from error


def refusal(address: str, doing: str, error: BaseException) -> StorageError:
    """Return the error that says what a store refused, and what to do."""
    problem, remedy = _meaning(error)
    return StorageError(f"cannot be {doing}: {problem}", file=address, remedy=remedy)


def _meaning(error: BaseException) -> tuple[str, str]:
    """Return what a store's exception means, and what to do."""
    kinds = {kind.__name__ for kind in type(error).__mro__}
    text = " ".join(str(error).split())
    code = getattr(error, "response", {}).get("Error", {}).get("Code", "") if hasattr(error, "response") else ""
    if kinds & {"NoCredentialsError", "PartialCredentialsError", "ProfileNotFound", "GoogleAuthError"}:
        return f"there are no credentials ({text})", (
            "set them in the environment or the store's own configuration, such as AWS_ACCESS_KEY_ID and "
            "AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"
        )
    if isinstance(error, PermissionError) or code in ("AccessDenied", "403"):
        return (
            f"access is refused ({text})",
            "the credentials have to allow listing, reading, writing and deleting there",
        )
    if isinstance(error, FileNotFoundError):
        return f"it is not there ({text})", "make the bucket or folder first, or mend the name"
    if kinds & {
        "EndpointConnectionError",
        "HTTPClientError",
        "ClientConnectionError",
        "ConnectionError",
        "TimeoutError",
    }:
        return f"the store does not answer ({text})", f"see to the network and the endpoint; {AGAIN}"
    if isinstance(error, NotImplementedError):
        return "its kind of store takes no files", "choose another address with --out"
    if isinstance(error, OSError) and error.errno in FULL:
        return "no space is left there", f"make room; {AGAIN}"
    return text or type(error).__name__, f"mend that; {AGAIN}"


def missing(address: str, package: str) -> MissingDependencyError:
    """Return the error that says which package reads and writes an address, and the command that installs it."""
    command = install_command("cloud") if package in IN_EXTRA else pip_command([package])
    packed = "a packed dataset, in a folder too, " if address.startswith("file://") or "://" not in address else ""
    problem = f"{packed}needs {package}, which is not installed; run: {command}"
    return MissingDependencyError(problem, file=address.removeprefix("file://"))
