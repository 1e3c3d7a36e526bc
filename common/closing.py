"""What holds a resource and is closed by `with`."""

from typing import Self


class Closing:
    """Gives `with` to a class that has `close`."""

    def close(self) -> None:
        """Release what is held."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
