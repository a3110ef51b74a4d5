"""Files in and out: refused before they are read, written aside and renamed; locks, digests, our logs, what ships."""
