"""Files of models."""

import pytest


@pytest.fixture
def written(tmp_path):
    """A function that writes text into a file of a new folder and returns its path."""

    def write(name, text):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode())
        return path

    return write
