"""What is imported into the node, and when not."""

import pytest

from tests.node import access, images, shell

NAME, BUILT = "contextpolicy-arm", "83bfef09"


@pytest.fixture
def containerd(tmp_path, monkeypatch):
    """What ctr was asked for; `has` is what it lists."""

    class Containerd:
        has: tuple[str, ...] = ()
        imported: list[str]

        def run(self, argv, **_):
            if "import" in argv:
                self.imported.append(argv[-1])
            return "\n".join(self.has) if "list" in argv else ""

    found = Containerd()
    found.imported = []
    socket = tmp_path / "containerd.sock"
    socket.touch()
    monkeypatch.setattr(images, "ROOT", tmp_path)
    monkeypatch.setattr(images, "CONTAINERD_SOCKET", socket)
    monkeypatch.setattr(access, "user_cluster", lambda: None)
    monkeypatch.setattr(shell, "run", found.run)
    return found


def test_an_image_is_imported_once(containerd):
    images._deliver(NAME, BUILT)
    containerd.has = (images.reference(NAME),)
    images._deliver(NAME, BUILT)
    assert len(containerd.imported) == 1


def test_another_build_is_imported(containerd):
    images._deliver(NAME, BUILT)
    containerd.has = (images.reference(NAME),)
    images._deliver(NAME, "5013b239")
    assert len(containerd.imported) == 2


def test_an_image_removed_by_the_kubelet_is_imported_again(containerd):
    """The kubelet removes images when the disk fills up."""
    images._deliver(NAME, BUILT)
    images._deliver(NAME, BUILT)
    assert len(containerd.imported) == 2
