"""Where the paper's data sets lie; their pages say what may be done with them. Sizes and checksums
are not published."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Source:
    """A data set, or a scene of one that comes scene by scene."""

    title: str
    page: str
    """Who made it, how to cite it, and what may be done with it."""
    folder: str
    """Where its files go, below the folder that is asked for."""
    files: tuple[str, ...]
    """Addresses; all but a .tsv are archives."""
    train: str
    """What to type then; {scene} is the folder of a capture."""


_GOOGLE = "https://storage.googleapis.com"
_MATCHING = "https://www.cs.ubc.ca/research/kmyi_data/imw2020/TrainingData"
_SPLITS = (
    "https://raw.githubusercontent.com/nerf-w/nerf-w.github.io/"
    "7069c87347ec8605ef43d373c794ece592ca3b37/data/selected_images"
)


def _photo_tourism(title: str, archive: str, split: str) -> Source:
    return Source(
        f"Photo Tourism, {title}: photos by many people, and NeRF-W's split",
        "https://www.cs.ubc.ca/~kmyi/imw2020/data.html",
        f"phototourism/{archive}",
        (f"{_MATCHING}/{archive}.tar.gz", f"{_SPLITS}/{split}.tsv"),
        "ns-train desplat-phototourism --data {scene}",
    )


SOURCES: dict[str, Source] = {
    "robustnerf": Source(
        "RobustNeRF: five scenes with clean and cluttered photos",
        "https://robustnerf.github.io",
        "robustnerf",
        (f"{_GOOGLE}/jax3d-public/projects/robustnerf/robustnerf.tar.gz",),
        "ns-train desplat --data {scene} robustnerf-data --downscale-factor 8",
    ),
    "on-the-go": Source(
        "NeRF On-the-go: scenes with people in 5 to 30% of the pixels",
        "https://rwn17.github.io/nerf-on-the-go/",
        "on-the-go",
        ("https://cvg-data.inf.ethz.ch/on-the-go.zip",),
        "ns-train desplat --data {scene} on-the-go-data --downscale-factor 8",
    ),
    "mipnerf360": Source(
        "Mip-NeRF 360: scenes in which nothing moves",
        "https://jonbarron.info/mipnerf360/",
        "mipnerf360",
        (f"{_GOOGLE}/gresearch/refraw360/360_v2.zip",),
        "ns-train desplat --data {scene} colmap --downscale-factor 4",
    ),
    "brandenburg-gate": _photo_tourism("Brandenburg Gate", "brandenburg_gate", "brandenburg"),
    "sacre-coeur": _photo_tourism("Sacre Coeur", "sacre_coeur", "sacre"),
    "trevi-fountain": _photo_tourism("Trevi Fountain", "trevi_fountain", "trevi"),
}
"""By the name that is typed."""
