from typing import Any, ClassVar

from tests.surface.mesh.methods.contract import MesherContract


class TestPoisson(MesherContract):
    method = "poisson"
    options: ClassVar[dict[str, Any]] = {"poisson_depth": 6}
