from tests.surface.mesh.methods.contract import MesherContract


class TestDelaunay(MesherContract):
    method = "delaunay-2.5d"
