"""What strangers say, made fit to be shown."""

LONGEST = 400  # characters


def plain_text(text: str) -> str:
    """The end of a stranger's words, on one line and without control characters."""
    words = " ".join("".join(c if c.isprintable() else " " for c in text[-5000:]).split())
    return words if len(words) <= LONGEST else f"…{words[-LONGEST:]}"
