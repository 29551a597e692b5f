from tests.surface.mesh.methods.contract import MesherContract


class TestBallPivoting(MesherContract):
    method = "ball-pivoting"
