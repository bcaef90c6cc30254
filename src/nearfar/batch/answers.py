"""The answer of one pair of a batch, and its line in a result file."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from nearfar.batch.pairs import Pair
from nearfar.errors import BenchmarkError, LocalizationError
from nearfar.landmarks import NO_LANDMARKS
from nearfar.localization import NO_POINTS, Localization
from nearfar.storage.rows import Row


@dataclass(frozen=True, eq=False)
class PairAnswer:
    """What came of a pair.

    Attributes:
        pair: the images.
        localization: the result; None where there was an error. One that was read back from a
            result file has no matches and no times.
        error: name of the exception, such as "ImageError", or "died" where the process died; None
            where there is a localization.
        reason: why there was an error, in one sentence; None where there is a localization.
        not_exported: why a format was not written, by the name of the format.
    """

    pair: Pair
    localization: Localization | None
    error: str | None = None
    reason: str | None = None
    not_exported: dict[str, str] = field(default_factory=dict)

    @property
    def status(self) -> str:
        """The outcome: "localized", "failed" (not found) or "error"."""
        return "error" if self.localization is None else self.localization.status

    def without_matches(self) -> "PairAnswer":
        """Return the answer without matches, which take most of the memory."""
        if self.localization is None:
            return self
        found = replace(self.localization, points=NO_POINTS, landmarks=NO_LANDMARKS)
        return replace(self, localization=found)

    def to_dict(self, key: str) -> Row:
        """Return the line of a result file: that of a localization, without its times.

        Without times, the same pairs give the same bytes.

        Args:
            key: hash of the settings of the batch.
        """
        if self.localization is None:
            unread = {"width": None, "height": None}
            return {
                "status": "error",
                "reason": self.reason,
                "error": self.error,
                "far": {"path": str(self.pair.far), **unread},
                "near": {"path": str(self.pair.near), **unread},
                "not_exported": self.not_exported,
                "settings": key,
            }
        answer = self.localization.to_dict()
        return answer | {"seconds": {}, "not_exported": self.not_exported, "settings": key}

    @staticmethod
    def from_dict(pair: Pair, row: Mapping[str, Any]) -> "PairAnswer":
        """Return the answer of a pair that `to_dict` has written.

        Raises:
            BenchmarkError: the line is damaged.
        """
        missed = dict(row.get("not_exported") or {})
        if row.get("status") == "error":
            return PairAnswer(pair, None, str(row["error"]), str(row["reason"]), missed)
        try:
            found = Localization.from_dict(row)
        except LocalizationError as error:
            raise BenchmarkError(f"the line of {pair.near} is damaged: {error}") from None
        return PairAnswer(pair, found, not_exported=missed)
