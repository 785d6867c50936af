"""`delaunay_meshing` against the program."""

import linecarve
import pytest
from linecarve._linecarve import main


@pytest.fixture(scope="module")
def city(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cloud") / "city"
    assert main(["linecarve", "--quiet", "synth", "city", "--points", "3000", "--out", str(folder)]) == 0
    return folder


def triangles(path):
    header = path.read_bytes().split(b"end_header")[0].decode()
    return int(header.split("element face ")[1].split()[0])


def test_the_mesh_is_that_of_the_program(city, tmp_path):
    linecarve.delaunay_meshing(city, tmp_path / "a.ply")
    assert main(["linecarve", "--quiet", "mesh", str(city), "--out", str(tmp_path / "b.ply")]) == 0
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    assert triangles(tmp_path / "a.ply") > 1000


def test_options_have_the_names_and_defaults_of_colmap(city, tmp_path):
    options = linecarve.DelaunayMeshingOptions()
    assert options.quality_regularization == 1.0
    options.quality_regularization = 4.0
    linecarve.delaunay_meshing(city, tmp_path / "smooth.ply", options, closed=True)
    linecarve.delaunay_meshing(city, tmp_path / "plain.ply", closed=True)
    assert triangles(tmp_path / "smooth.ply") != triangles(tmp_path / "plain.ply")


def test_faults_are_exceptions(city, tmp_path):
    with pytest.raises(linecarve.Error, match="nothing.ply"):
        linecarve.delaunay_meshing(tmp_path / "nothing.ply", tmp_path / "mesh.ply")
    with pytest.raises(ValueError, match="quality_regularization"):
        options = linecarve.DelaunayMeshingOptions(quality_regularization=-1.0)
        linecarve.delaunay_meshing(city, tmp_path / "mesh.ply", options)
