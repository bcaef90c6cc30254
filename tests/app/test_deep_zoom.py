"""Images by parts: tiles that are made when they are asked for, within the limits of the app."""

import asyncio
import io
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from nearfar.app.configuration import Limits
from nearfar.app.deep_zoom import DeepZoom
from nearfar.app.errors import BusyError, NotFoundError
from nearfar.app.parts import SIDE, Levels
from nearfar.app.zoom_tiles import MakeTile, TileMaker, tile_file
from nearfar.errors import ImageError
from tests.app.attacks import Attack
from tests.app.browser import Page
from tests.app.conftest import PIXELS, Server
from tests.app.test_limits import tiff_bomb

rasterio = pytest.importorskip("rasterio")

WIDTH, HEIGHT = 3000, 1400


def scene() -> NDArray[np.uint8]:
    """(HEIGHT, WIDTH, 3): red grows to the right, green downwards."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.dstack([columns * 250 // WIDTH, rows * 250 // HEIGHT, columns * 0 + 90]).astype(
        np.uint8
    )


@pytest.fixture(scope="module")
def orthophoto(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file: Path = tmp_path_factory.mktemp("large") / "orthophoto.tif"
    write(file)
    return file


def write(file: Path, overviews: tuple[int, ...] = ()) -> None:
    size = {"width": WIDTH, "height": HEIGHT, "count": 3, "dtype": "uint8"}
    place = {"crs": "EPSG:32633", "transform": rasterio.Affine(0.1, 0, 5e5, 0, -0.1, 5e6)}
    kind = {"driver": "GTiff", "tiled": True, "compress": "deflate", "photometric": "RGB"}
    with rasterio.open(file, "w", **size, **place, **kind) as dataset:
        dataset.write(np.moveaxis(scene(), -1, 0))
        if overviews:
            dataset.build_overviews(overviews, rasterio.enums.Resampling.average)


def task(file: Path, folder: Path, level: int, column: int, row: int) -> MakeTile:
    return MakeTile(
        kind="tile", file=file, folder=folder, max_pixels=PIXELS, max_tiled_pixels=10**7,
        level=level, column=column, row=row,
    )  # fmt: skip


@pytest.mark.parametrize("overviews", [(), (2, 4)])
def test_tiles_show_the_image_at_every_level(
    overviews: tuple[int, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("nearfar.app.zoom_tiles.MOST_REDUCED", 2)  # So that tiles are joined too.
    write(tmp_path / "large.tif", overviews)
    maker, levels, whole = TileMaker(), Levels(WIDTH, HEIGHT), scene()
    assert levels.finest == 3
    for level, column, row in ((3, 5, 2), (3, 3, 1), (1, 1, 0), (0, 0, 0)):
        ended = maker.do(task(tmp_path / "large.tif", tmp_path, level, column, row))
        assert (ended.error, ended.size) == (None, (WIDTH, HEIGHT))
        with Image.open(tile_file(tmp_path, level, column, row)) as opened:
            pixels = np.asarray(opened)
        tile = levels.tile(level, column, row)
        assert tile is not None
        assert pixels.shape == (tile.rows, tile.columns, 3)
        window = whole[tile.top : tile.top + tile.height, tile.left : tile.left + tile.width]
        factor = 2 ** (levels.finest - level)
        middle = window[factor // 2 :: factor, factor // 2 :: factor][: tile.rows, : tile.columns]
        shown = pixels[: middle.shape[0], : middle.shape[1]]
        assert np.abs(shown.astype(int) - middle).mean() < 2
    assert levels.tile(3, 6, 0) is None
    assert levels.tile(4, 0, 0) is None


def test_images_that_cannot_be_read_by_parts_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("nearfar.app.parts.LARGEST_BLOCK", 3000 * 1000)
    image = Image.fromarray(scene())
    image.save(tmp_path / "strip.tif", compression="tiff_adobe_deflate", tiffinfo={278: HEIGHT})
    image.save(tmp_path / "turned.tif", tiffinfo={274: 6})
    (tmp_path / "bomb.tif").write_bytes(tiff_bomb())
    for name, said in (
        ("bomb", "more than the limit of 10000000"),
        ("turned", "more than the limit of 4000000"),
        ("strip", "by parts: convert it with `gdal_translate -co TILED=YES`"),
    ):
        ended = TileMaker().do(task(tmp_path / f"{name}.tif", tmp_path, 0, 0, 0))
        assert said in str(ended.error)


def test_tiles_keep_the_limits_of_time_and_disk(orthophoto: Path, tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    Image.fromarray(scene()[:1100, :1200]).save(picture)

    async def kept() -> None:
        zoom = DeepZoom(tmp_path / "tiles", Limits(pixels=PIXELS, tiles=1))
        try:
            assert zoom.is_needed(orthophoto)
            assert not zoom.is_needed(picture)
            with Image.open(io.BytesIO(await zoom.preview(orthophoto))) as small:
                assert small.size == (375, 175)
                left, right = (np.array(small.getpixel((x, 90)))[0] for x in (20, 350))
            assert right - left > 150
            with pytest.raises(NotFoundError):
                await zoom.tile(orthophoto, 3, 6, 0)
            assert len(list((tmp_path / "tiles").rglob("*.jpg"))) == 1
            with Image.open(io.BytesIO(await zoom.tile(picture, 2, 2, 2))) as corner:
                assert corner.size == (1200 - 2 * SIDE, 1100 - 2 * SIDE)
            files = list((tmp_path / "tiles").rglob("*.jpg"))
            few = sum(file.stat().st_size for file in files) - 1
            zoom._limits = Limits(pixels=PIXELS, tile_bytes=few)
            await zoom.tile(picture, 2, 2, 2)
            assert [file.exists() for file in files] == [file.name == "2-2.jpg" for file in files]
            process = await zoom._lane.worker.start()
            os.kill(process.pid, signal.SIGSTOP)
            zoom._lane._seconds = 0.2
            waiting = asyncio.create_task(zoom.preview(orthophoto))
            await asyncio.sleep(0.05)
            with pytest.raises(BusyError):
                await zoom.tile(picture, 2, 1, 0)
            with pytest.raises(ImageError, match="cannot be read within"):
                await waiting
            assert process.returncode is not None
        finally:
            await zoom.close()

    asyncio.run(kept())


def test_a_large_orthophoto_is_shown_by_parts(page: Page, server: Server, served: Path) -> None:
    write(served / "orthophoto.tif", (2, 4, 8))
    Image.fromarray(scene()[:600, :600]).save(served / "part.png")
    far, near = (server.ref(served / name) for name in ("orthophoto.tif", "part.png"))
    info = server.get("/api/images/info", ref=far)
    assert (info["width"], info["tiles"], info["parts"]) == (WIDTH, True, True)
    for query, status in (("level=9&column=0&row=0", 404), ("level=-1&column=0&row=0", 422)):
        refused = Attack("GET", f"/api/images/tile?ref={far}&{query}", ())
        assert refused.send(server).status == status
    outside = Attack("GET", f"/api/images/tile?ref={far}/../x&level=0&column=0&row=0", ())
    assert outside.send(server).status == 404
    note = server.post("/api/annotations", {"far": far, "near": near})["annotation"]["id"]
    page.open(f"#/annotate/{note}")
    page.find(".editor[data-ready]")
    page.click(".canvas-view[data-tiles] canvas")
    for _ in range(8):
        page.press("+")
    page.wait(lambda: page.all("[data-tiles=whole]"))
    colour = page.driver.execute_script(
        "const c = document.querySelector('.canvas-view[data-tiles] canvas');"
        "return [...c.getContext('2d').getImageData(c.width >> 1, c.height >> 1, 1, 1).data]"
    )
    assert np.abs(np.array(colour[:3]) - scene()[HEIGHT // 2, WIDTH // 2]).max() < 8
    assert not page.errors()
