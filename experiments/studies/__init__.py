"""What the studies beyond the dissertation do alike: how one is conducted, and which targets it has."""
