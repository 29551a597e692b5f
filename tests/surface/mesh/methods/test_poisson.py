from tests.surface.mesh.methods.contract import MesherContract


class TestPoisson(MesherContract):
    method = "poisson"
    options = {"poisson_depth": 6}
