"""Resources that are closed by `with`."""

from typing import Self


class Closing:
    """Makes a class with a `close` usable in `with`."""

    def close(self) -> None:
        """Release the resource."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
