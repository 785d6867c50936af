"""The carver on arrays."""

import numpy as np
import pytest

import linecarve


def box(size=4.0, steps=5):
    """Points on the sides of a box and a view inside."""
    at = np.linspace(0.0, size, steps)
    x, y, z = np.meshgrid(at, at, at)
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    on_side = (points == 0.0).any(axis=1) | (points == size).any(axis=1)
    return points[on_side], np.array([[0.5, 0.51, 0.52]]) * size


def carved(points, centers, **options):
    carver = linecarve.Carver(**options)
    with carver.transaction() as change:
        ids = change.add_points(points)
        views = change.add_views(centers)
        change.add_observations(views[0], ids)
    return carver, ids, views


def soup(mesh):
    """The triangles by positions, in an order of their own."""
    return sorted(tuple(map(tuple, corners)) for corners in mesh.vertices[mesh.triangles])


@pytest.mark.parametrize("labels", ["votes", "cut"])
def test_a_box_has_the_surface_of_a_box(labels):
    points, centers = box()
    carver, ids, views = carved(points, centers, labels=labels, hull="keep")
    assert ids.dtype == np.uint32 and list(ids) == list(range(len(points)))
    assert (carver.point_count, carver.view_count, carver.ray_count) == (len(points), 1, len(points))
    mesh = carver.surface()
    assert mesh.vertices.shape[1] == 3 and mesh.vertices.dtype == np.float64
    assert mesh.triangles.shape == (carver.triangle_count, 3) and mesh.triangles.dtype == np.uint32
    assert mesh.colors is None and mesh.vertices is mesh.vertices
    assert mesh.triangles.max() < len(mesh.vertices)
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    # Votes free only the cells that a ray crosses; the cut frees the rest of the box as well.
    assert abs(volume) == pytest.approx(64.0) if labels == "cut" else 32.0 < abs(volume) < 64.0


def test_the_surface_does_not_depend_on_the_order_of_changes():
    points, centers = box()
    whole, *_ = carved(points, centers)
    carver = linecarve.Carver()
    with carver.transaction() as change:
        views = change.add_views(centers + 1.0)
    order = np.random.default_rng(1).permutation(len(points))
    for part in np.array_split(order, 4):
        change = carver.transaction()
        ids = change.add_points(points[part] + 0.25)
        change.add_observations(np.full(len(ids), views[0]), ids, np.ones(len(ids), int))
        change.commit()
        change = carver.transaction()
        change.move_points(ids, points[part])
        change.commit()
    with carver.transaction() as change:
        wrong = change.add_points([[1.0, 2.0, 3.0]], sigma=0.1)
        change.add_observations(views, wrong)
        change.move_views(views, centers)
    with carver.transaction() as change:
        change.remove_points(wrong)
    assert soup(carver.surface()) == soup(whole.surface())


def test_a_commit_tells_what_changed():
    points, centers = box()
    carver = linecarve.Carver()
    change = carver.transaction()
    ids = change.add_points(points)
    views = change.add_views(centers)
    change.add_observations(views, ids)
    first = change.commit()
    assert len(first.added) == carver.triangle_count and len(first.removed) == 0
    assert first.seconds > 0.0 and first.duplicates == 0
    corners = carver.vertex_positions(first.added.ravel()).reshape(-1, 3, 3)
    assert corners.shape == (len(first.added), 3, 3)
    with carver.transaction() as change:
        change.remove_observations(views[0], ids)
    assert (carver.ray_count, carver.triangle_count) == (0, 0)


def test_what_is_refused_changes_nothing():
    points, centers = box()
    carver, ids, views = carved(points, centers)
    before = soup(carver.surface())
    change = carver.transaction()
    change.add_points([[9.0, 9.0, 9.0]])
    change.remove_points(12345)
    with pytest.raises(ValueError, match="12345"):
        change.commit()
    with pytest.raises(RuntimeError, match="has ended"):
        change.commit()
    with pytest.raises(ValueError, match=r"\(n, 3\)"):
        carver.transaction().add_points([[1.0, 2.0]])
    with pytest.raises(ValueError, match="weights has 2"):
        carver.transaction().add_observations(views[0], ids, [1, 2])
    with pytest.raises(ValueError, match="-1"):
        carver.transaction().remove_points(-1)
    with pytest.raises(ZeroDivisionError):
        with carver.transaction() as change:
            change.remove_points(ids)
            1 / 0
    one, two = carver.transaction(), carver.transaction()
    one.add_points([[1.0, 1.0, 1.0]])
    two.add_points([[2.0, 2.0, 2.0]])
    one.commit()
    with pytest.raises(RuntimeError, match="another transaction"):
        two.commit()
    with carver.transaction() as change:
        change.remove_points(len(points))
    assert soup(carver.surface()) == before


def test_options_are_checked():
    for wrong in [dict(labels="best"), dict(hull="open"), dict(threshold=0), dict(relative_sigma=0.1)]:
        with pytest.raises(ValueError):
            linecarve.Carver(**wrong)
    with pytest.raises(ValueError, match="relative_sigma"):
        linecarve.Carver("cut", relative_sigma=-1.0)
    with pytest.raises(ValueError, match="no vertex"):
        linecarve.Carver().vertex_positions([7])
