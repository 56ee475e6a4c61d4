"""Features, matches and poses of photos by pycolmap, plainly or thoroughly. Runs in the worker.

COLMAP's database and models are the record of what is done: what is in them is not done again.
Where the camera moves, the scene moves in the picture, and what stays is fixed to the camera: a
watermark, a dashboard, the photographer's stick. Matches at equal pixel positions tie photos that
share nothing. Letters in shapes: M matches.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
from jaxtyping import Bool, Float

from desplat_ns.errors import CaptureError
from desplat_ns.files.whole import write_whole
from desplat_ns.process import pairs
from desplat_ns.process.photos import Camera
from desplat_ns.process.request import MIN_PHOTOS, Pairing
from desplat_ns.process.worker import Progress

Count = Callable[[int, int], None]
"""Called with what is done of a stage and what there is to do."""

PHOTOS_AT_ONCE = 2
"""Of each thread in one call: few, so that progress is seen and a kill costs little."""
PAIRS_AT_ONCE = 50
"""In one call, for the same reason."""
PAIRS_LOOKED_AT = 1000
"""For matches at equal positions."""
OFF_OF_SIDE = 0.003
"""Of the longer side: how far a match may be off its epipolar line, and how far apart positions may
be that count as equal. 5 pixels of 1600."""
LEAST_ERROR, MOST_ERROR = 1.5, 4.0
"""Pixels off the line. 4 is COLMAP's for photos of any size; in one of 480 pixels that ties what is
not the same, and focal lengths of ten tourists' photos came out at half of what they are."""
LEAST_TOLERANCE = 2.0
"""Pixels between equal positions, for small photos."""
SUSPICIOUS = 0.3
"""Share of all verified matches at equal positions from which on they are left out."""
SEED = 1
"""Of COLMAP's random numbers: the same photos give the same poses on one thread."""
FEW = 200
"""Observations of each photo on average below which poses are not relied on: with 130 the centres
of ten tourists' photos were off by percents of the scene's extent, with 700 by a thousandth."""


@dataclass(frozen=True)
class Recipe:
    """How features are found, matched and mapped."""

    name: str
    longest_side: int
    """Pixels at which features are looked for; 0: those of the photo."""
    most_features: int
    """Of each photo, the largest ones."""
    peak_threshold: float
    """Of differences of Gaussians; COLMAP's is 0.0067. Lower finds fainter features."""
    domain_size_pooling: bool
    """Descriptors averaged over ten sizes of their patch: slower, and truer on gloss."""
    affine_shape: bool
    """Whether the patch of a feature is an ellipse that fits what is seen from aside."""
    guided: bool
    """Whether matches are looked for again along the epipolar lines of the first ones."""
    pose_inliers: int
    """Matches that a photo's pose needs at least; COLMAP's is 30."""
    neighbours: int
    """Photos that each is matched with, where not all pairs are."""
    filtered: tuple[float, float] | None
    """Pixels of reprojection error above which observations go at the end, and degrees between the
    rays to a point below which it goes, before the last adjustment."""


PLAIN = Recipe("plain", 1000, 4096, 0.02 / 3, False, False, False, 30, 20, None)
"""Enough for most captures: photos with structure, taken close to one another."""

THOROUGH = Recipe("thorough", 0, 8192, 0.002, True, True, True, 15, 40, (2.5, 2.0))
"""For gloss, bare walls and far views. Measured on 44 photos of a glossy thing, of which plain
features at 960 pixels pose 11 and 12 apart: a lower threshold at full size poses 42, pooling and
guided matching with a filter at 2.5 pixels and 2 degrees all 44. On ten tourists' photos of 480
pixels pooling without affine shapes poses 7; with both all ten, within 1% of the known centres."""


@dataclass(frozen=True)
class Stationary:
    """Verified matches at equal pixel positions in both photos."""

    share: float
    """Of all that were looked at."""
    box: Sequence[float] = ()
    """Left, top, right and bottom of nine tenths of them, as shares of width and height."""

    @property
    def is_suspicious(self) -> bool:
        """Whether they are so many that they are left out."""
        return self.share >= SUSPICIOUS


@dataclass(frozen=True)
class Model:
    """A model that was found."""

    folder: Path
    photos: tuple[str, ...]
    """Names of the copies that have a pose, sorted."""
    points: int
    observations: int
    error: float
    """Mean reprojection error in pixels."""


@dataclass(frozen=True)
class Attempt:
    """What came out of one recipe."""

    recipe: Recipe
    models: Sequence[Model]
    """The one with most photos first."""
    features: Mapping[str, int]
    """Of each copy."""
    pairs: Sequence[tuple[str, str, int]]
    """Names of two copies and the number of their verified matches, where there are any."""
    stationary: Stationary

    @property
    def score(self) -> tuple[int, int]:
        """Photos and observations of the first model: more photos are better, and with as many
        more observations."""
        return (len(self.models[0].photos), self.models[0].observations) if self.models else (0, 0)

    @property
    def is_thin(self) -> bool:
        """Whether poses hang on few observations."""
        photos, observations = self.score
        return observations < FEW * photos


def reconstruct(
    place: Path,
    photos: Path,
    cameras: Sequence[Camera],
    masks: Path | None,
    pairing: Pairing,
    recipe: Recipe,
    threads: int,
    progress: Progress,
) -> Attempt:
    """Find poses of photos by a recipe; goes on where an earlier call was stopped.

    Args:
        place: a folder for this recipe: database.db with features and matches, matching.json once
            all pairs are matched, models once there are poses.
        photos: folder of the copies.
        masks: folder with COPY.png, or None.
        pairing: which pairs are matched.

    Raises:
        CaptureError: the camera stands still.
    """
    place.mkdir(parents=True, exist_ok=True)
    database = place / "database.db"

    def counts(stage: str) -> Count:
        return partial(progress, f"{stage} ({recipe.name})")

    features = find_features(database, photos, cameras, masks, recipe, threads, counts("features"))
    stationary = match_photos(database, pairing, recipe, threads, counts("matching"))
    verified = verified_pairs(database)
    if stationary.is_suspicious and len(verified) < MIN_PHOTOS - 1:
        raise CaptureError(
            "The camera does not move: matches between photos sit at equal pixel positions, and "
            "without those hardly any are left. Depth is seen from different places only: walk "
            "around while taking photos. If a watermark or a part of the camera's stand is all "
            "that matches, the photos share no place."
        )
    models = map_photos(database, photos, place / "models", recipe, threads, counts("mapping"))
    return Attempt(recipe, models, features, verified, stationary)


# --- features ------------------------------------------------------------------------------------


def find_features(
    database: Path,
    photos: Path,
    cameras: Sequence[Camera],
    masks: Path | None,
    recipe: Recipe,
    threads: int,
    progress: Count,
) -> dict[str, int]:
    """Enter cameras, photos and their SIFT features; photos that have them already are passed over.

    Returns:
        The number of features of each copy.
    """
    for camera in cameras:
        _enter(database, photos, camera)
    reader = pycolmap.ImageReaderOptions()
    if masks is not None:
        reader.mask_path = masks
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = threads
    options.max_image_size = recipe.longest_side or -1
    options.sift.max_num_features = recipe.most_features
    options.sift.peak_threshold = recipe.peak_threshold
    options.sift.domain_size_pooling = recipe.domain_size_pooling
    options.sift.estimate_affine_shape = recipe.affine_shape
    counts = feature_counts(database)
    missing = [name for name, count in counts.items() if count is None]
    step = PHOTOS_AT_ONCE * threads
    for start in range(0, len(missing), step):
        progress(len(counts) - len(missing) + start, len(counts))
        names = missing[start : start + step]
        pycolmap.extract_features(
            database, photos, names, reader_options=reader, extraction_options=options
        )
    progress(len(counts), len(counts))
    return {name: count or 0 for name, count in feature_counts(database).items()}


def feature_counts(database: Path) -> dict[str, int | None]:
    """Features of each copy; None where they were not looked for yet."""
    with pycolmap.Database.open(database) as db:
        return {
            image.name: db.num_keypoints_for_image(image.image_id)
            if db.exists_keypoints(image.image_id)
            else None
            for image in sorted(db.read_all_images(), key=lambda image: image.name)
        }


def _enter(database: Path, photos: Path, camera: Camera) -> None:
    """The camera and its photos, with the focal length to start from: EXIF's, or COLMAP's guess,
    which is 1.2 times the longer side."""
    with pycolmap.Database.open(database) as db:
        known = {image.name for image in db.read_all_images()}
    if known.issuperset(camera.copies):
        return
    options = pycolmap.ImageReaderOptions(camera_model=camera.model)
    if camera.focal:
        start = pycolmap.Camera.create_from_model_name(
            0, camera.model, camera.focal, camera.width, camera.height
        )
        options.camera_params = ",".join(map(repr, map(float, start.params)))
    pycolmap.import_images(
        database, photos, pycolmap.CameraMode.SINGLE, list(camera.copies), options
    )


# --- matches -------------------------------------------------------------------------------------


def match_photos(
    database: Path, pairing: Pairing, recipe: Recipe, threads: int, progress: Count
) -> Stationary:
    """Match pairs of photos and verify them by epipolar geometry; those that are matched already
    are passed over.

    Where suspiciously many matches sit at equal pixel positions, all are verified again without
    those.
    """
    record = database.with_name("matching.json")
    if not record.is_file():
        _match(database, _chosen_pairs(database, pairing, recipe), recipe, threads, progress)
        share, box = _stationary(database)
        write_whole(record, json.dumps({"share": share, "box": box}).encode())
    stationary = Stationary(**json.loads(record.read_text("utf8")))
    if stationary.is_suspicious:
        with pycolmap.Database.open(database) as db:
            db.clear_two_view_geometries()
        side = _longest_side(database)
        options = _verification(side)
        options.filter_stationary_matches = True
        options.stationary_matches_max_error = tolerance_of(side)
        verifier = pycolmap.GeometricVerifierOptions()
        verifier.num_threads = threads
        pycolmap.geometric_verification(database, verifier, two_view_geometry_options=options)
    return stationary


def verified_pairs(database: Path) -> list[tuple[str, str, int]]:
    """Names of two photos and how many matches were verified, for pairs that have any."""
    with pycolmap.Database.open(database) as db:
        names = {image.image_id: image.name for image in db.read_all_images()}
        ids, counts = db.read_two_view_geometry_num_inliers()
    both = (pycolmap.pair_id_to_image_pair(pair) for pair in ids)
    return [(names[a], names[b], n) for (a, b), n in zip(both, counts, strict=True) if n > 0]


def _chosen_pairs(database: Path, pairing: Pairing, recipe: Recipe) -> list[tuple[str, str]]:
    with pycolmap.Database.open(database) as db:
        images = sorted(db.read_all_images(), key=lambda image: image.name)
        count = len(images)
        if pairing == "auto":
            pairing = "exhaustive" if count <= pairs.ALL_PAIRS_UP_TO else "similar"
        if pairing == "exhaustive":
            chosen = pairs.all_pairs(count)
        else:

            def descriptors(index: int) -> np.ndarray:
                data = db.read_descriptors(images[index].image_id).data
                return np.asarray(data, dtype=np.float32).reshape(-1, 128)

            likeness = pairs.similarities(count, descriptors)
            if pairing == "similar":
                chosen = pairs.similar_pairs(likeness, recipe.neighbours)
            else:
                loops = pairs.similar_pairs(likeness, pairs.LOOPS)
                chosen = sorted({*pairs.sequential_pairs(count), *loops})
    return [(images[a].name, images[b].name) for a, b in chosen]


def _match(
    database: Path,
    chosen: Sequence[tuple[str, str]],
    recipe: Recipe,
    threads: int,
    progress: Count,
) -> None:
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = threads
    options.guided_matching = recipe.guided
    listed, verification = database.with_name("pairs.txt"), _verification(_longest_side(database))
    for start in range(0, len(chosen), PAIRS_AT_ONCE):
        progress(start, len(chosen))
        chunk = chosen[start : start + PAIRS_AT_ONCE]
        listed.write_text("".join(f"{a} {b}\n" for a, b in chunk), "utf8")
        pairing = pycolmap.ImportedPairingOptions(match_list_path=listed)
        pycolmap.match_image_pairs(database, options, pairing, verification)
    progress(len(chosen), len(chosen))


def verification_error(longest_side: int) -> float:
    """Pixels that a match may be off its epipolar line, in photos of that size."""
    return min(MOST_ERROR, max(LEAST_ERROR, OFF_OF_SIDE * longest_side))


def tolerance_of(longest_side: int) -> float:
    """Pixels by which equal positions may differ."""
    return max(LEAST_TOLERANCE, OFF_OF_SIDE * longest_side)


def is_stationary(
    first: Float[np.ndarray, "M 2"], second: Float[np.ndarray, "M 2"], tolerance: float
) -> Bool[np.ndarray, " M"]:
    """Which matches are at the same place in both photos, to `tolerance` pixels."""
    return np.linalg.norm(first - second, axis=1) <= tolerance


def _longest_side(database: Path) -> int:
    with pycolmap.Database.open(database) as db:
        return max(max(camera.width, camera.height) for camera in db.read_all_cameras())


def _verification(longest_side: int) -> pycolmap.TwoViewGeometryOptions:
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.max_error = verification_error(longest_side)
    options.ransac.random_seed = 0
    return options


def _stationary(database: Path) -> tuple[float, list[float]]:
    """`Stationary.share` and `box` of verified matches, in an even choice of pairs."""
    with pycolmap.Database.open(database) as db:
        cameras = {camera.camera_id: camera for camera in db.read_all_cameras()}
        camera_of = {i.image_id: cameras[i.camera_id] for i in db.read_all_images()}
        ids, counts = db.read_two_view_geometry_num_inliers()
        tied = [pair for pair, count in zip(ids, counts, strict=True) if count > 0]
        total, found = 0, [np.zeros((0, 2))]
        for pair in tied[:: max(1, len(tied) // PAIRS_LOOKED_AT)]:
            a, b = pycolmap.pair_id_to_image_pair(pair)
            matches = db.read_two_view_geometry(a, b).inlier_matches
            first = db.read_keypoints(a)[matches[:, 0], :2].astype(float)
            second = db.read_keypoints(b)[matches[:, 1], :2].astype(float)
            size = camera_of[a].width, camera_of[a].height
            same = is_stationary(first, second, tolerance_of(max(size)))
            total += len(matches)
            found.append(first[same] / size)
    places = np.concatenate(found)
    if len(places) == 0:
        return 0.0, []
    return len(places) / total, np.quantile(places, [0.05, 0.95], axis=0).ravel().tolist()


# --- poses ---------------------------------------------------------------------------------------


def map_photos(
    database: Path, photos: Path, models: Path, recipe: Recipe, threads: int, progress: Count
) -> list[Model]:
    """Find poses and points from verified matches, incrementally; `models` gets a folder for each
    model, and is there only once all are.

    Returns:
        The models, the one with most photos first.
    """
    if not models.is_dir():
        part = models.with_suffix(".part")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir()
        _map(database, photos, part, recipe, threads, progress)
        part.rename(models)
    found = [_described(folder) for folder in sorted(models.iterdir())]
    return sorted(found, key=lambda model: (-len(model.photos), model.error))


def _map(
    database: Path, photos: Path, folder: Path, recipe: Recipe, threads: int, progress: Count
) -> None:
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = threads
    options.random_seed = SEED
    options.min_model_size = MIN_PHOTOS
    options.mapper.abs_pose_min_num_inliers = recipe.pose_inliers
    with pycolmap.Database.open(database) as db:
        total = db.num_images()
    placed = 0

    def one_more() -> None:
        nonlocal placed
        placed += 1
        progress(min(placed, total), total)

    mapped = pycolmap.incremental_mapping(
        database,
        photos,
        folder,
        options,
        initial_image_pair_callback=one_more,
        next_image_callback=one_more,
    )
    for index, model in mapped.items():
        if recipe.filtered is not None:
            pycolmap.ObservationManager(model).filter_all_points3D(*recipe.filtered)
            pycolmap.bundle_adjustment(model)
            model.update_point_3d_errors()
            (folder / str(index)).mkdir(exist_ok=True)
            model.write(folder / str(index))


def _described(folder: Path) -> Model:
    model = pycolmap.Reconstruction(folder)
    return Model(
        folder=folder,
        photos=tuple(sorted(model.image(i).name for i in model.reg_image_ids())),
        points=model.num_points3D(),
        observations=model.compute_num_observations(),
        error=float(np.nan_to_num(model.compute_mean_reprojection_error())),
    )
