"""Generated scenes, small ones, laid out as the published data sets lie on the disk: folders, names
of files, camera models, and what COLMAP left out.

docs/compare-with-desplat.md says where each layout is known from ("What lies where").
"""

import csv
import json
import os
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import PIL.Image  # noqa: F401  before pycolmap, see lab.synthetic.layouts
import pycolmap

from desplat_ns.tools.studies.paper import TABLES, TableName
from lab.pictures import write_image
from lab.synthetic import Frame, Scene, SceneSpec, make_scene
from lab.synthetic.layouts import RegisteredPhoto, register, write_reconstruction

TINY = SceneSpec.tiny()

ENLARGED = 8
"""How many times larger the photos in `images` are than those in `images_8`, which are drawn."""

DISTORTION = (1e-3, -1e-4, 1e-5, -1e-5)
"""k1, k2, p1, p2 of photos as a camera made them; so little that nobody sees it."""

SPLITS = {"brandenburg_gate": "brandenburg", "sacre_coeur": "sacre", "trevi_fountain": "trevi"}
"""NeRF-W's split files, by the scenes' folders."""

Writer = Callable[[Scene, Path], None]


def write_data_sets(folder: Path, spec: SceneSpec = TINY) -> None:
    """Every scene of every table, each in its data set's folder; scenes of a data set are one.

    Args:
        spec: of the scenes; those of Photo Tourism have changing light besides.
    """
    scene = make_scene(spec)
    writers: dict[TableName, Writer] = {
        "robustnerf": write_robustnerf,
        "on-the-go": write_on_the_go,
        "A6": write_mipnerf360,
    }
    for name, write in writers.items():
        first, *others = (folder / s.data_set / s.folder for s in TABLES[name].scenes)
        write(scene, first)
        for other in others:
            shutil.copytree(first, other, copy_function=os.link)
    tourism = make_scene(changing_light(spec))
    for entry in TABLES["A5"].scenes:
        write_photo_tourism(tourism, folder / entry.data_set / entry.folder)


def changing_light(spec: SceneSpec) -> SceneSpec:
    """The same scene as tourists photograph it."""
    tourism = SceneSpec.tourism()
    return replace(spec, daylight=tourism.daylight, wall_height=tourism.wall_height)


def write_robustnerf(scene: Scene, home: Path) -> None:
    """`images/{0clean,1extra,2clutter}NNN.png` with a copy `images_8`, one OPENCV camera."""
    kinds = (("2clutter", scene.clutter), ("0clean", scene.clean), ("1extra", scene.extra))
    names = {
        frame.name: f"{kind}{number:03d}.png"
        for kind, frames in kinds
        for number, frame in enumerate(frames, start=1)
    }
    frames = [*scene.clutter, *scene.clean, *scene.extra]
    _write_photos(frames, names, home, copies=(8,))
    (home / "database.db").touch()
    _write_model(scene, scene.clutter + scene.clean, names, home / "sparse" / "0", DISTORTION)


def write_on_the_go(scene: Scene, home: Path) -> None:
    """`images/IMG_NNNN.JPG`, `transforms.json` and `split.json`, as in the archive: no COLMAP
    model, one photo that no list has, and one without a pose, which does not count in the lists."""
    frames, names = _numbered(scene, home)
    posed = [{"file_path": f"./images/{names[f.name]}", **_pose(f)} for f in frames]
    k1, k2, p1, p2 = DISTORTION
    camera = _enlarged(frames[0])
    lens = {"fl_x": camera.K[0, 0], "fl_y": camera.K[1, 1], "k1": k1, "k2": k2, "p1": p1, "p2": p2}
    lens |= {"cx": camera.K[0, 2], "cy": camera.K[1, 2], "w": camera.width, "h": camera.height}
    content = {**lens, "is_fisheye": False, "frames": posed[::-1]}
    (home / "transforms.json").write_text(json.dumps(content))


def write_photo_tourism(scene: Scene, home: Path) -> None:
    """`dense/{images,sparse,stereo}` with a camera for each photo, and NeRF-W's split beside: ids
    are written as 3.0, and rows without one are of photos that COLMAP left out."""
    frames = [*scene.clutter, *scene.extra]
    flickr = {f.name: f"{104729 * n:08d}_{96293 * n:010d}.jpg" for n, f in enumerate(frames, 1)}
    _write_photos(frames, flickr, home / "dense", enlarged=1)
    (home / "dense" / "stereo").mkdir()
    _write_model(scene, scene.clutter, flickr, home / "dense" / "sparse", enlarged=1)
    split = SPLITS.get(home.name, home.name)
    rows = [(flickr[f.name], f"{n}.0", "test") for n, f in enumerate(scene.extra, 1)]
    rows += [(flickr[f.name], f"{n}.0", "train") for n, f in enumerate(scene.clutter, 101)]
    rows += [("01790346_0189659192.jpg", "", "train")]
    with (home / f"{split}.tsv").open("w", newline="") as file:
        table = csv.writer(file, delimiter="\t", lineterminator="\n")
        table.writerow(("filename", "id", "split", "dataset"))
        table.writerows((*row, split) for row in rows)


def write_mipnerf360(scene: Scene, home: Path) -> None:
    """`images/DSCNNNNN.JPG` with copies `images_2`, `images_4`, `images_8`, one PINHOLE camera."""
    frames = [*scene.clean, *scene.extra]
    names = {frame.name: f"DSC{7956 + number:05d}.JPG" for number, frame in enumerate(frames)}
    _write_photos(frames, names, home, copies=(2, 4, 8))
    np.save(home / "poses_bounds.npy", np.zeros((len(frames), 17)))
    _write_model(scene, scene.clean, names, home / "sparse" / "0")


def _numbered(scene: Scene, home: Path) -> tuple[list[Frame], dict[str, str]]:
    """On-the-go's photos and `split.json`: held-out ones come first, then cluttered ones, and the
    last in no list. Among the names is that of a photo without a pose."""
    frames = [*scene.extra, *scene.clutter]
    keys = [frames[0].name, "unposed", *(frame.name for frame in frames[1:])]
    names = {key: f"IMG_{number:04d}.JPG" for number, key in enumerate(keys)}
    _write_photos(frames, names, home)
    shutil.copy(home / "images" / names[frames[0].name], home / "images" / names["unposed"])
    held_out = len(scene.extra)
    lists = {"clutter": [*range(held_out, len(frames) - 1)], "extra": [*range(held_out)]}
    (home / "split.json").write_text(json.dumps(lists))
    return frames, names


def _pose(frame: Frame) -> dict[str, list[list[float]]]:
    """As instant-ngp writes it: camera to world, y up and z backwards."""
    pose = np.linalg.inv(frame.camera.viewmat) @ np.diag([1.0, -1.0, -1.0, 1.0])
    return {"transform_matrix": pose.tolist()}


def _enlarged(frame: Frame, times: int = ENLARGED):
    """Its camera as of a photo so many times larger."""
    camera = frame.camera
    return camera.with_size(times * camera.width, times * camera.height)


def _write_photos(
    frames: Iterable[Frame],
    names: dict[str, str],
    home: Path,
    copies: Sequence[int] = (),
    enlarged: int = ENLARGED,
) -> None:
    """Photos in `images`, and smaller ones in `images_N` for each N of `copies`."""
    for frame in frames:
        width, height = enlarged * frame.camera.width, enlarged * frame.camera.height
        for smaller in (1, *copies):
            size = (width // smaller, height // smaller)
            image = cv2.resize(frame.image, size, interpolation=cv2.INTER_NEAREST)
            folder = "images" if smaller == 1 else f"images_{smaller}"
            write_image(home / folder / names[frame.name], image)


def _write_model(
    scene: Scene,
    training: Sequence[Frame],
    names: dict[str, str],
    folder: Path,
    distortion: tuple[float, ...] = (),
    enlarged: int = ENLARGED,
) -> None:
    """A model by an older COLMAP: three files, photos in another order than that of their names."""
    photos = [
        RegisteredPhoto(
            names[photo.name.removesuffix(".png")],
            photo.camera.with_size(enlarged * photo.camera.width, enlarged * photo.camera.height),
            photo.point_ids,
            enlarged * photo.pixels,
        )
        for photo in register(scene, training)
    ]
    write_reconstruction(folder, photos[::-1], scene.points.xyz, scene.points.rgb)
    if distortion:
        model = pycolmap.Reconstruction(folder)
        for camera in model.cameras.values():
            camera.params = [*camera.params, *distortion]
            camera.model = pycolmap.CameraModelId.OPENCV
        model.write_binary(str(folder))
    for newer in ("rigs.bin", "frames.bin"):
        (folder / newer).unlink(missing_ok=True)
