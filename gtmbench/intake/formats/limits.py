"""How large a log may be: what bounds the memory and the time that any file, however made, can take."""

from __future__ import annotations

from gtmbench.files import LARGEST_LOG_BYTES

LARGEST_FILE_BYTES = LARGEST_LOG_BYTES
LARGEST_CHUNK_BYTES = 1 << 26  # of a container, unpacked
MOST_UNPACKED_BYTES = 1 << 31  # of a whole file
MOST_COLUMNS = 5_000
MOST_MESSAGES = 10_000_000
MOST_VALUES = 200_000_000  # samples times channels: 1.6 GB of doubles
LONGEST_LINE_BYTES = 1 << 20  # or message of text
