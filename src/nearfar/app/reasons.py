"""Reasons why a format cannot be written, without the words of commands and of Python."""

import re

_REPLACED = (
    (r"\s*\([^()]*(?:--|=)[^()]*\)", ""),  # "(--model homography)", "(far=, near=)"
    (r"the localization failed \(.*\)", "the near image was not found"),
    (r": pip install 'nearfar\[(\w+)\].*", r", which is not installed (the extra \1)"),
)


def in_plain_words(reason: str) -> str:
    """Return a reason of `nearfar.exports` for somebody who uses neither commands nor Python."""
    for words, plain in _REPLACED:
        reason = re.sub(words, plain, reason)
    return reason
