import numpy as np
import pytest

from semsfm_colmap.io.open3d_rays import as_tensor, ray_scene
from semsfm_colmap.synthetic.motion import make_motion, view_of
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.scenes import build_specimen
from semsfm_colmap.synthetic.scenes.clump import COIL_PITCH, RIBBON_WIDTH
from semsfm_colmap.synthetic.visible_cloud import MAX_SLANT_DEG, MIN_VIEWS, visible_cloud

SIGMA_PX = 0.5


def options_of(scene):
    return SynthesizeOptions(
        scene=scene,
        seed=5,
        num_images=8,
        width_px=200,
        height_px=150,
        databar=False,
        mesh_edge_px=2.0,
    )


@pytest.fixture(scope="module", params=["grain", "clump", "field"])
def seen(request):
    return options_of(request.param), visible_cloud(options_of(request.param), sigma_px=SIGMA_PX)


def test_points_lie_off_the_surface_by_the_noise(seen):
    options, cloud = seen
    rng = np.random.default_rng(options.seed).spawn(4)
    motion = make_motion(options, rng[0])
    specimen = build_specimen(options.scene, view_of(options, motion), rng[1])
    distance = ray_scene(specimen.vertices, specimen.faces).compute_distance(
        as_tensor(cloud.cloud.points.astype(np.float32))
    )
    off_px = distance.numpy() * float(motion.cameras.scale_px_per_unit.mean())
    # rough surfaces come near to a point from aside: the distance is at most the displacement
    assert np.percentile(off_px, 99.9) < 4 * SIGMA_PX
    assert 0.3 * SIGMA_PX < np.sqrt(np.mean(off_px**2)) < 1.05 * SIGMA_PX


def test_every_point_faces_images_that_hold_it(seen):
    _, cloud = seen
    facing = np.zeros(len(cloud.label), dtype=int)
    for i in range(len(cloud.cameras)):
        uv = cloud.cloud.points @ cloud.cameras.projection[i].T + cloud.cameras.translation_px[i]
        inside = np.all((uv > -3) & (uv < cloud.image_size_px[i] + 3), axis=1)
        slant = cloud.cloud.normals @ -cloud.cameras.viewing_direction[i]
        facing += inside & (slant > np.cos(np.radians(MAX_SLANT_DEG)))
    assert facing.min() >= MIN_VIEWS


def test_the_holder_is_seen_where_there_is_one(seen):
    options, cloud = seen
    share = np.mean(cloud.label)
    assert share == 0 if options.scene == "field" else 0.02 < share < 0.5


def test_both_sides_of_the_ribbon_are_seen():
    cloud = visible_cloud(options_of("clump"), sigma_px=0.0)
    ribbon = cloud.label == 1
    points, normals = cloud.cloud.points[ribbon], cloud.cloud.normals[ribbon]
    radial = points[:, 1:] / np.linalg.norm(points[:, 1:], axis=1, keepdims=True)
    outward = np.einsum("ni,ni->n", radial, normals[:, 1:])
    outer, inner = np.sum(outward > 0.7), np.sum(outward < -0.7)
    # the inner side is seen through the gaps between the turns alone
    gap = 1.0 - RIBBON_WIDTH / COIL_PITCH
    assert 0.05 * outer < inner < gap * outer
