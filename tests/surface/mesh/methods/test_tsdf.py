from tests.surface.mesh.methods.contract import MesherContract


class TestTsdf(MesherContract):
    method = "tsdf"
