"""Features, matches and poses of photos by pycolmap, plainly or thoroughly.

COLMAP's database and models are the record of what is done: what is in them is not done again.
Where the camera moves, the scene moves in the picture, and what stays is fixed to the camera: a
watermark, a dashboard, the photographer's stick. Matches at equal pixel positions, which would tie
photos that share nothing, are left out.

How alike photos look follows from their features alone, by VLAD (Jégou et al., Aggregating Local
Descriptors into a Compact Image Representation, CVPR 2010): the features of a photo are summed up
as their differences from the nearest of a few words, which are learned from the same photos.
Letters in shapes: N photos, F features, D numbers of a descriptor, W words.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from itertools import combinations, count
from pathlib import Path

import cv2
import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
from jaxtyping import Float32

from desplat_ns.console import progress_with_time_left
from desplat_ns.errors import CaptureError
from desplat_ns.files.whole import draft_of
from desplat_ns.process.photos import Camera
from desplat_ns.process.request import MIN_PHOTOS

# All that pycolmap tells stands on the console else, between the bars of progress.
pycolmap.logging.minloglevel = pycolmap.logging.ERROR.value

Count = Callable[[int, int], None]
"""Called with what is done of a stage and what there is to do."""

PHOTOS_AT_ONCE = 2
"""Of each thread in one call: few, so that progress is seen and a kill costs little."""
PAIRS_AT_ONCE = 200
"""In one call, for the same reason."""
ALL_PAIRS_UP_TO = 200
"""Photos: 19,900 pairs. Above, pairs by image similarity."""
OVERLAP = 10
"""Frames of a video that each is matched with before and after it; then every doubled distance."""
LOOPS = 5
"""Of a video's frames further away, so many that look most alike."""
WORDS = 64
SAMPLES = 100_000
"""Features that the words are learned from, at most."""
OFF_OF_SIDE = 0.003
"""Of the longer side: how far a match may be off its epipolar line, and how far apart positions may
be that count as equal. 5 pixels of 1600."""
LEAST_ERROR, MOST_ERROR = 1.5, 4.0
"""Pixels off the line. 4 is COLMAP's for photos of any size; in one of 480 pixels that ties what is
not the same, and focal lengths of ten tourists' photos came out at half of what they are."""
LEAST_TOLERANCE = 2.0
"""Pixels between equal positions, for small photos."""
SEED = 1
"""Of COLMAP's random numbers: the same photos give the same poses on one thread."""
MANY = 100
"""Matches of two photos that do not come about by chance."""
FEW = 200
"""Observations of each photo on average below which poses are not relied on: with 130 the centres
of ten tourists' photos were off by percents of the scene's extent, with 700 by a thousandth."""

Pair = tuple[int, int]
"""Two photos by their places in the list, the smaller first."""


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
    careful: bool
    """Whether descriptors are averaged over ten sizes of their patch, which is slower and truer on
    gloss; patches are ellipses that fit what is seen from aside; and matches are looked for again
    along the epipolar lines of the first ones."""
    pose_inliers: int
    """Matches that a photo's pose needs at least; COLMAP's is 30."""
    neighbours: int
    """Photos that each is matched with, where not all pairs are."""
    filtered: tuple[float, float] | None
    """Pixels of reprojection error above which observations go at the end, and degrees between the
    rays to a point below which it goes, before the last adjustment."""


PLAIN = Recipe("plain", 1000, 4096, 0.02 / 3, False, 30, 20, None)
"""Enough for most captures: photos with structure, taken close to one another."""

THOROUGH = Recipe("thorough", 0, 8192, 0.002, True, 15, 40, (2.5, 2.0))
"""For gloss, bare walls and far views. Measured on 44 photos of a glossy thing, of which plain
features at 960 pixels pose 11 and 12 apart: a lower threshold at full size poses 42, pooling and
guided matching with a filter at 2.5 pixels and 2 degrees all 44. On ten tourists' photos of 480
pixels pooling without affine shapes poses 7; with both all ten, within 1% of the known centres."""


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
    is_video: bool,
    recipe: Recipe,
    threads: int,
) -> Attempt:
    """Find poses of photos by a recipe, with a bar for each stage; goes on where an earlier call
    was stopped.

    Args:
        place: a folder for this recipe: database.db with features and matches, models once there
            are poses.
        photos: folder of the copies.
        masks: folder with COPY.png, or None.
        is_video: whether photos follow each other as frames do.

    Raises:
        CaptureError: the camera stands still.
    """
    place.mkdir(parents=True, exist_ok=True)
    database = place / "database.db"

    def stage(name: str) -> AbstractContextManager[Count]:
        return progress_with_time_left(f"{name} ({recipe.name})")

    with stage("Features") as show:
        features = find_features(database, photos, cameras, masks, recipe, threads, show)
    with stage("Matching") as show:
        match_photos(database, is_video, recipe, threads, show)
    matched, verified = verified_pairs(database)
    if matched >= MIN_PHOTOS > len(verified) + 1:
        raise CaptureError(
            "The camera does not move: matches between photos sit at equal pixel positions, and "
            "without those hardly any are left. Depth is seen from different places only: walk "
            "around while taking photos. If a watermark or a part of the camera's stand is all "
            "that matches, the photos share no place."
        )
    with stage("Mapping") as show:
        models = map_photos(database, photos, place / "models", recipe, threads, show)
    return Attempt(recipe, models, features, verified)


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

    A camera starts with EXIF's focal length, or with COLMAP's guess, 1.2 times the longer side.

    Returns:
        The number of features of each copy.
    """
    entered = feature_counts(database).keys()
    for camera in cameras:
        if not entered >= set(camera.copies):
            reader = pycolmap.ImageReaderOptions(camera_model=camera.model)
            if camera.focal:
                start = pycolmap.Camera.create_from_model_name(
                    0, camera.model, camera.focal, camera.width, camera.height
                )
                reader.camera_params = ",".join(map(repr, map(float, start.params)))
            mode, copies = pycolmap.CameraMode.SINGLE, list(camera.copies)
            pycolmap.import_images(database, photos, mode, copies, reader)
    reader = pycolmap.ImageReaderOptions()
    if masks is not None:
        reader.mask_path = masks
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = threads
    options.max_image_size = recipe.longest_side or -1
    options.sift.max_num_features = recipe.most_features
    options.sift.peak_threshold = recipe.peak_threshold
    options.sift.domain_size_pooling = recipe.careful
    options.sift.estimate_affine_shape = recipe.careful
    counts = feature_counts(database)
    missing = [name for name, found in counts.items() if found is None]
    step = PHOTOS_AT_ONCE * threads
    for start in range(0, len(missing), step):
        progress(len(counts) - len(missing) + start, len(counts))
        names = missing[start : start + step]
        pycolmap.extract_features(
            database, photos, names, reader_options=reader, extraction_options=options
        )
    return {name: found or 0 for name, found in feature_counts(database).items()}


def feature_counts(database: Path) -> dict[str, int | None]:
    """Features of each copy; None where they were not looked for yet."""
    with pycolmap.Database.open(database) as db:
        return {
            image.name: db.num_keypoints_for_image(image.image_id)
            if db.exists_keypoints(image.image_id)
            else None
            for image in sorted(db.read_all_images(), key=lambda image: image.name)
        }


# --- matches -------------------------------------------------------------------------------------


def match_photos(
    database: Path, is_video: bool, recipe: Recipe, threads: int, progress: Count
) -> None:
    """Match pairs of photos and verify them by epipolar geometry; those that are matched already
    are passed over."""
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = threads
    options.guided_matching = recipe.careful
    with pycolmap.Database.open(database) as db:
        images = sorted(db.read_all_images(), key=lambda image: image.name)
        side = max(max(camera.width, camera.height) for camera in db.read_all_cameras())

        def descriptors(index: int) -> np.ndarray:
            data = db.read_descriptors(images[index].image_id).data
            return np.asarray(data, dtype=np.float32).reshape(-1, 128)

        if is_video:
            loops = similar_pairs(similarities(len(images), descriptors), LOOPS)
            chosen = sorted({*sequential_pairs(len(images)), *loops})
        elif len(images) > ALL_PAIRS_UP_TO:
            chosen = similar_pairs(similarities(len(images), descriptors), recipe.neighbours)
        else:
            chosen = list(combinations(range(len(images)), 2))
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.max_error = min(MOST_ERROR, max(LEAST_ERROR, OFF_OF_SIDE * side))
    verification.ransac.random_seed = 0
    verification.filter_stationary_matches = True
    verification.stationary_matches_max_error = max(LEAST_TOLERANCE, OFF_OF_SIDE * side)
    listed = database.with_name("pairs.txt")
    for start in range(0, len(chosen), PAIRS_AT_ONCE):
        progress(start, len(chosen))
        chunk = chosen[start : start + PAIRS_AT_ONCE]
        lines = (f"{images[a].name} {images[b].name}\n" for a, b in chunk)
        listed.write_text("".join(lines), "utf8")
        pairing = pycolmap.ImportedPairingOptions(match_list_path=listed)
        pycolmap.match_image_pairs(database, options, pairing, verification)


def sequential_pairs(count: int) -> list[Pair]:
    """Neighbours, and further ones at doubling distances."""
    steps = [*range(1, OVERLAP + 1), *(OVERLAP * 2**k for k in range(1, 12))]
    return sorted((i, i + step) for i in range(count) for step in steps if i + step < count)


def similar_pairs(likeness: Float32[np.ndarray, "N N"], neighbours: int) -> list[Pair]:
    """For each photo those most like it; a pair is in if one of both asks for it."""
    scores = likeness.copy()
    np.fill_diagonal(scores, -np.inf)
    order = np.argsort(-scores, axis=1, kind="stable")[:, : min(neighbours, len(scores) - 1)]
    pairs = {(min(i, int(j)), max(i, int(j))) for i, row in enumerate(order) for j in row}
    return sorted(pairs)


def similarities(
    count: int, descriptors: Callable[[int], Float32[np.ndarray, "_ D"]]
) -> Float32[np.ndarray, "N N"]:
    """Cosines between photos, in [-1, 1]; 0 for photos without features.

    Args:
        count: of the photos.
        descriptors: gives those of a photo. It is asked twice for each, one after another: those
            of 2,000 photos are 8 GB, and need not be in memory together.
    """
    rng = np.random.default_rng(0)
    each = max(1, SAMPLES // max(1, count))
    photos = (descriptors(i) for i in range(count))
    some = [photo[rng.permutation(len(photo))[:each]] for photo in photos]
    words = _words(np.concatenate(some, dtype=np.float32))
    vectors = np.stack([_vlad(descriptors(i), words) for i in range(count)])
    return vectors @ vectors.T


def _words(samples: Float32[np.ndarray, "F D"]) -> Float32[np.ndarray, "W D"]:
    """Centres of the samples' clusters."""
    if len(samples) == 0:
        return np.zeros((1, samples.shape[1]), np.float32)
    cv2.setRNGSeed(0)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 1e-4)
    labels = np.empty((0,), np.int32)
    count = min(WORDS, len(samples))
    return cv2.kmeans(samples, count, labels, criteria, 1, cv2.KMEANS_PP_CENTERS)[2]


def _vlad(
    features: Float32[np.ndarray, "F D"], words: Float32[np.ndarray, "W D"]
) -> Float32[np.ndarray, " WD"]:
    """One vector of length 1, or of zeros without features."""
    sums = np.zeros_like(words)
    if len(features):
        # |f - w|^2 without |f|^2, which is the same for all words
        nearest = ((words**2).sum(1) - 2 * features @ words.T).argmin(1)
        np.add.at(sums, nearest, features - words[nearest])
    norms = np.linalg.norm(sums, axis=1, keepdims=True)
    vector = (sums / np.maximum(norms, 1e-9)).ravel()
    return (vector / max(float(np.linalg.norm(vector)), 1e-9)).astype(np.float32)


def verified_pairs(database: Path) -> tuple[int, list[tuple[str, str, int]]]:
    """How many pairs have `MANY` matches, and, of those of which any were verified, names of both
    photos and the number that was."""
    with pycolmap.Database.open(database) as db:
        names = {image.image_id: image.name for image in db.read_all_images()}
        _, matches = db.read_num_matches()
        ids, counts = db.read_two_view_geometry_num_inliers()
    both = (pycolmap.pair_id_to_image_pair(pair) for pair in ids)
    found = [(names[a], names[b], n) for (a, b), n in zip(both, counts, strict=True) if n > 0]
    return sum(count >= MANY for count in matches), found


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
        options = pycolmap.IncrementalPipelineOptions()
        options.num_threads = threads
        options.random_seed = SEED
        options.min_model_size = MIN_PHOTOS
        options.mapper.abs_pose_min_num_inliers = recipe.pose_inliers
        with pycolmap.Database.open(database) as db:
            total = db.num_images()
        placed = count(1)

        def one_more() -> None:
            progress(min(next(placed), total), total)

        with draft_of(models) as folder:
            folder.mkdir()
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
    found = []
    for folder in sorted(models.iterdir()):
        model = pycolmap.Reconstruction(folder)
        names = sorted(model.image(i).name for i in model.reg_image_ids())
        error = float(np.nan_to_num(model.compute_mean_reprojection_error()))
        observations = model.compute_num_observations()
        found.append(Model(folder, tuple(names), model.num_points3D(), observations, error))
    return sorted(found, key=lambda model: (-len(model.photos), model.error))
