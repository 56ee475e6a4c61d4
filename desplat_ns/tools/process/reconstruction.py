"""Features, matches and poses of photos by pycolmap, plainly or thoroughly.

COLMAP's database and models are the record of what is done: what is in them is not done again.
Where the camera moves, the scene moves in the picture, and what stays is fixed to the camera: a
watermark, a dashboard, the photographer's stick. Matches at equal pixel positions, which would tie
photos that share nothing, are left out.

How alike photos look follows from their features, by VLAD (Jégou et al., CVPR 2010): the features
of a photo are summed up as their differences from the nearest of a few words, learned from them.
Letters in shapes: N photos, D numbers of a descriptor.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
from jaxtyping import Float32, UInt8

from desplat_ns.core.console import progress_over, progress_with_time_left
from desplat_ns.core.cores import cores
from desplat_ns.core.errors import CaptureError
from desplat_ns.tools.process.photos import Photo, group_by_camera
from desplat_ns.tools.process.request import MIN_PHOTOS, CameraModel, Request

# All that pycolmap tells stands on the console else, between the bars of progress.
pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
TERMS = ((10, "RADIAL"), (3, "SIMPLE_RADIAL"), (1, "SIMPLE_PINHOLE"))
"""From so many photos of one camera on: two, one or no term of radial distortion. A term of a
single photo takes up whatever does not fit, up to values that no lens has."""
PHOTOS_AT_ONCE, PAIRS_AT_ONCE = 2, 8
"""Of each core in one call, see `in_blocks`. A call takes 0.05 s more."""
ALL_PAIRS_UP_TO = 200
"""Photos: 19,900 pairs. Above, pairs by image similarity."""
OVERLAP = 10
"""Frames of a video that each is matched with before and after it; then every doubled distance."""
LOOPS = 5
"""Of a video's frames further away, so many that look most alike."""
WORDS, SAMPLES = 64, 100_000
"""How many words there are, and the features that they are learned from, at most."""
OFF_OF_SIDE = 0.003
"""Of the longer side: how far a match may be off its epipolar line, and how far apart positions may
be that count as equal. 5 pixels of 1600."""
LEAST_ERROR, MOST_ERROR = 1.5, 4.0
"""Pixels off the line. 4 is COLMAP's for photos of any size; in one of 480 pixels that ties what is
not the same, and focal lengths of ten tourists' photos came out at half of what they are."""
LEAST_TOLERANCE = 2.0
"""Pixels between equal positions, for small photos."""
MANY = 100
"""Matches of two photos that do not come about by chance."""
FEW = 200
"""Observations of each photo on average below which poses are not relied on: with 130 the centres
of ten tourists' photos were off by percents of the scene's extent, with 700 by a thousandth."""
BENT = 0.7
"""Mean reprojection error in pixels, of photos of the plain recipe's size or smaller, above which
poses are not relied on. Eight sets of photos have 0.25 to 0.57; with zoom, a rolling shutter or
panoramas, and centres off by 2 to 21% of the scene and more, it is 0.80 to 0.96."""


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
    side: int = 0
    """Pixels of the longest one of its photos."""

    @property
    def is_bent(self) -> bool:
        """Whether the error says that poses are off."""
        return self.error > BENT * max(1.0, self.side / PLAIN.longest_side)


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
    def first(self) -> Model:
        """The model with most photos; one without any where none was found."""
        return self.models[0] if self.models else Model(Path(), (), 0, 0, 0.0)

    @property
    def score(self) -> tuple[float, int]:
        """Photos and observations of the first model: more photos are better, and with as many
        more observations. Photos that are off count half."""
        return len(self.first.photos) / (1 + self.first.is_bent), self.first.observations


def reconstruct(request: Request, photos: Sequence[Photo], recipe: Recipe) -> Attempt:
    """Find poses of photos, whose copies and masks lie in the work folder. Features and matches of
    an earlier call are kept. Raises CaptureError where the camera stands still."""
    work = request.output / "work"
    copies, place = work / "photos", work / recipe.name
    found = place / ("models" if any(photo.focal for photo in photos) else "models_without_exif")
    place.mkdir(parents=True, exist_ok=True)
    database, cameras = place / "database.db", group_by_camera(photos, request.cameras)
    enter_photos(database, copies, cameras, request.camera_model)
    features = find_features(database, copies, recipe)
    match_photos(database, request.is_video, recipe)
    matched, verified = verified_pairs(database)
    if matched >= MIN_PHOTOS > len(verified) + 1:
        raise CaptureError(
            "The camera does not move: matches between photos sit at equal pixel positions, and "
            "without those hardly any are left. Walk around while taking photos. If a watermark or "
            "a part of the camera's stand is all that matches, the photos share no place."
        )
    return Attempt(recipe, map_photos(database, copies, found, recipe), features, verified)


def enter_photos(
    database: Path, copies: Path, cameras: Sequence[Sequence[Photo]], camera_model: CameraModel
) -> None:
    """Enter photos by their cameras, unless they are there. A camera starts with EXIF's focal
    length, or with COLMAP's guess; where that has changed, matches are verified anew."""
    entered = feature_counts(database).keys()
    for group in cameras:
        names, size = [photo.copy for photo in group], (group[0].width, group[0].height)
        fitting = next(name for least, name in TERMS if len(group) >= least)
        model = fitting if camera_model == "auto" else camera_model
        known = [photo.focal for photo in group if photo.focal]
        focal = float(median(known)) if known else 1.2 * max(size)  # COLMAP's guess
        start = pycolmap.Camera.create_from_model_name(0, model, focal, *size)
        if entered >= set(names):
            with pycolmap.Database.open(database) as db:
                image = db.read_image_with_name(names[0])
                assert image is not None, "entered before"
                start.camera_id, start.has_prior_focal_length = image.camera_id, bool(known)
                if not np.array_equal(db.read_camera(start.camera_id).params, start.params):
                    db.update_camera(start)
                    db.clear_two_view_geometries()
            continue
        reader = pycolmap.ImageReaderOptions(camera_model=model)
        if known:
            reader.camera_params = ",".join(map(repr, map(float, start.params)))
        pycolmap.import_images(database, copies, pycolmap.CameraMode.SINGLE, names, reader)


def find_features(database: Path, copies: Path, recipe: Recipe) -> dict[str, int]:
    """The number of SIFT features of each copy, where `masks` allow any; those there are kept."""
    reader = pycolmap.ImageReaderOptions(mask_path=copies.with_name("masks"))
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = cores()
    options.max_image_size = recipe.longest_side or -1
    options.sift.max_num_features = recipe.most_features
    options.sift.peak_threshold = recipe.peak_threshold
    options.sift.domain_size_pooling = recipe.careful
    options.sift.estimate_affine_shape = recipe.careful
    names = sorted(name for name, features in feature_counts(database).items() if not features)
    for some in in_blocks(names, PHOTOS_AT_ONCE, f"Features ({recipe.name})"):
        pycolmap.extract_features(
            database, copies, some, reader_options=reader, extraction_options=options
        )
    return feature_counts(database)


def in_blocks(items: Sequence[Any], at_once: int, label: str) -> Iterator[Sequence[Any]]:
    """So many items for each core at a time, with a bar: few, so that a kill costs little."""
    size = at_once * cores()
    with progress_with_time_left(label) as show:
        for start in range(0, len(items), size):
            show(start, len(items))
            yield items[start : start + size]


def feature_counts(database: Path) -> dict[str, int]:
    """Features of each copy; 0 also where they were not looked for yet."""
    with pycolmap.Database.open(database) as db:
        images = db.read_all_images()
        return {image.name: db.num_keypoints_for_image(image.image_id) for image in images}


def match_photos(database: Path, is_video: bool, recipe: Recipe) -> None:
    """Match pairs of photos that are not matched yet, and verify them by epipolar geometry."""
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = cores()
    options.guided_matching = recipe.careful
    with pycolmap.Database.open(database) as db:
        images = sorted(db.read_all_images(), key=lambda image: image.name)
        side = max(max(camera.width, camera.height) for camera in db.read_all_cameras())
        if is_video or len(images) > ALL_PAIRS_UP_TO:
            found = [db.read_descriptors(image.image_id).data for image in images]
            likeness = similarities([each.reshape(-1, 128) for each in found])
            chosen = similar_pairs(likeness, LOOPS if is_video else recipe.neighbours)
            if is_video:
                chosen = sorted({*sequential_pairs(len(images)), *chosen})
        else:
            chosen = list(combinations(range(len(images)), 2))
        ids = [image.image_id for image in images]
        chosen = [(a, b) for a, b in chosen if not db.exists_two_view_geometry(ids[a], ids[b])]
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.max_error = min(MOST_ERROR, max(LEAST_ERROR, OFF_OF_SIDE * side))
    verification.ransac.random_seed = 0
    verification.filter_stationary_matches = True
    verification.stationary_matches_max_error = max(LEAST_TOLERANCE, OFF_OF_SIDE * side)
    listed = database.with_name("pairs.txt")
    for some in in_blocks(chosen, PAIRS_AT_ONCE, f"Matching ({recipe.name})"):
        lines = (f"{images[a].name} {images[b].name}\n" for a, b in some)
        listed.write_text("".join(lines), "utf8")
        pairing = pycolmap.ImportedPairingOptions(match_list_path=listed)
        pycolmap.match_image_pairs(database, options, pairing, verification)


def sequential_pairs(count: int) -> list[tuple[int, int]]:
    """Places of neighbours in the list, and of further ones at doubling distances."""
    steps = [*range(1, OVERLAP + 1), *(OVERLAP * 2**k for k in range(1, 12))]
    return sorted((i, i + step) for i in range(count) for step in steps if i + step < count)


def similar_pairs(likeness: Float32[np.ndarray, "N N"], neighbours: int) -> list[tuple[int, int]]:
    """For each photo those most like it; a pair is in if one of both asks for it."""
    scores = likeness.copy()
    np.fill_diagonal(scores, -np.inf)
    order = np.argsort(-scores, axis=1, kind="stable")[:, : min(neighbours, len(scores) - 1)]
    return sorted({(min(i, int(j)), max(i, int(j))) for i, row in enumerate(order) for j in row})


def similarities(photos: Sequence[UInt8[np.ndarray, "_ D"]]) -> Float32[np.ndarray, "N N"]:
    """Cosines between photos by their descriptors, in [-1, 1]; 0 for photos without features."""
    rng = np.random.default_rng(0)
    each = max(1, SAMPLES // len(photos))
    some = [photo[rng.permutation(len(photo))[:each]] for photo in photos]
    samples = np.concatenate(some, dtype=np.float32)
    cv2.setRNGSeed(0)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 1e-4)
    labels, most = np.empty((0,), np.int32), min(WORDS, len(samples))
    words = cv2.kmeans(samples, most, labels, criteria, 1, cv2.KMEANS_PP_CENTERS)[2]
    vectors = []
    for photo in photos:
        features = photo.astype(np.float32)
        # |f - w|^2 without |f|^2, which is the same for all words
        nearest = ((words**2).sum(1) - 2 * features @ words.T).argmin(1)
        sums = np.zeros_like(words)
        np.add.at(sums, nearest, features - words[nearest])
        vector = (sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)).ravel()
        vectors.append(vector / max(float(np.linalg.norm(vector)), 1e-9))
    return np.stack(vectors) @ np.stack(vectors).T


def verified_pairs(database: Path) -> tuple[int, list[tuple[str, str, int]]]:
    """How many pairs have `MANY` matches; names and numbers of those with verified matches."""
    with pycolmap.Database.open(database) as db:
        names = {image.image_id: image.name for image in db.read_all_images()}
        _, matches = db.read_num_matches()
        ids, counts = db.read_two_view_geometry_num_inliers()
    both = (pycolmap.pair_id_to_image_pair(pair) for pair in ids)
    found = [(names[a], names[b], n) for (a, b), n in zip(both, counts, strict=True) if n > 0]
    return sum(count >= MANY for count in matches), found


def map_photos(database: Path, photos: Path, models: Path, recipe: Recipe) -> list[Model]:
    """Find poses and points from verified matches; the models, the one with most photos first."""
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = cores()
    options.random_seed = 1  # on one thread the same photos give the same poses
    options.min_model_size = MIN_PHOTOS
    options.mapper.abs_pose_min_num_inliers = recipe.pose_inliers
    shutil.rmtree(models, ignore_errors=True)
    models.mkdir()
    total, label = len(feature_counts(database)), f"Mapping ({recipe.name})"
    with progress_over(total, label, alike=False) as one_more:
        moments = "initial_image_pair_callback", "next_image_callback"
        told: dict[str, Any] = dict.fromkeys(moments, one_more)
        mapped = pycolmap.incremental_mapping(database, photos, models, options, **told)
    found = []
    for index, model in mapped.items():
        if recipe.filtered is not None:
            pycolmap.ObservationManager(model).filter_all_points3D(*recipe.filtered)
            # bundle_adjustment (4.2.1) turns on the log lines of all pycolmap: the same without it
            config = pycolmap.BundleAdjustmentConfig()
            for image_id in model.reg_image_ids():
                config.add_image(image_id)
            config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
            quiet = pycolmap.BundleAdjustmentOptions(print_summary=False)
            pycolmap.create_default_bundle_adjuster(quiet, config, model).solve()
            model.update_point_3d_errors()
        folder = models / str(index)
        folder.mkdir(exist_ok=True)
        model.write(folder)
        names = sorted(model.image(i).name for i in model.reg_image_ids())
        error = float(np.nan_to_num(model.compute_mean_reprojection_error()))
        side = max(max(camera.width, camera.height) for camera in model.cameras.values())
        points, observations = model.num_points3D(), model.compute_num_observations()
        found.append(Model(folder, tuple(names), points, observations, error, side))
    return sorted(found, key=lambda model: (-len(model.photos), model.error))
