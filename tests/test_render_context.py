"""One way to a GL context, and a clear reason when there is none."""

import moderngl
import numpy as np
import pytest

import guise.render.context
from guise.render import GLInfo, GLMissing, RendererError, create_context, make_compositor, probe_gl

TRIANGLE = (
    np.array([[0, 1, 2]], np.int32),
    np.array([[0, 0], [8, 0], [0, 8]], np.float32),
    np.ones((9, 9), np.float32),
)


@pytest.fixture
def no_gl(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(**settings: object) -> moderngl.Context:
        raise Exception(f"{settings.get('libegl', 'libEGL.so')} not loaded")

    monkeypatch.setattr(moderngl, "create_context", fail)
    monkeypatch.setattr("sys.platform", "linux")


@pytest.mark.egl
def test_context_is_new_enough_and_free_of_errors() -> None:
    context = create_context()
    try:
        assert context.version_code >= guise.render.context.MIN_GL_VERSION
        assert context.error == "GL_NO_ERROR"
    finally:
        context.release()


@pytest.mark.egl
def test_probe_describes_the_renderer() -> None:
    found = probe_gl()
    assert isinstance(found, GLInfo)
    assert found.description
    assert found.version


@pytest.mark.parametrize(
    ("renderer", "software"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("softpipe", True),
        ("Google SwiftShader", True),
        ("NVIDIA GeForce RTX 4070/PCIe/SSE2", False),
        ("Mesa Intel(R) Iris(R) Xe Graphics", False),
    ],
)
def test_software_renderers_are_known_by_name(renderer: str, software: bool) -> None:
    class Context:
        info = {"GL_RENDERER": renderer, "GL_VENDOR": "vendor", "GL_VERSION": "4.5"}  # noqa: RUF012

    assert guise.render.context.describe(Context()).software is software


@pytest.mark.usefixtures("no_gl")
def test_failure_names_every_attempt_its_reason_and_what_to_install() -> None:
    with pytest.raises(RendererError) as caught:
        create_context()
    message = str(caught.value)
    assert message == (
        "no GL context could be made (EGL: libEGL.so not loaded; "
        "EGL from libEGL.so.1 and libGL.so.1: libEGL.so.1 not loaded; "
        "EGL from libEGL.so.1 and libOpenGL.so.0: libEGL.so.1 not loaded): "
        "install libegl1 and libgl1-mesa-dri (Debian, Ubuntu), mesa-libEGL and mesa-dri-drivers (Fedora), "
        "or choose --renderer cpu"
    )


@pytest.mark.usefixtures("no_gl")
def test_probe_gives_the_reason_as_a_false_value() -> None:
    found = probe_gl()
    assert isinstance(found, GLMissing)
    assert not found
    assert "libegl1" in found.reason


@pytest.mark.usefixtures("no_gl")
def test_gl_asked_for_and_missing_is_an_error() -> None:
    with pytest.raises(RendererError, match="no GL context could be made"):
        make_compositor("gl", *TRIANGLE)


@pytest.mark.usefixtures("no_gl")
def test_auto_without_gl_is_the_cpu_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("guise.render.compositor.may_have_hardware", lambda: True)
    with make_compositor("auto", *TRIANGLE) as compositor:
        assert compositor.name == "cpu"
        assert "not loaded" in compositor.description


def test_a_later_attempt_may_succeed(monkeypatch: pytest.MonkeyPatch) -> None:
    class Context:
        error = "GL_NO_ERROR"

    def create(**settings: object) -> Context:
        if "libegl" not in settings:
            raise Exception("libEGL.so not loaded")
        return Context()

    monkeypatch.setattr(moderngl, "create_context", create)
    monkeypatch.setattr("sys.platform", "linux")
    assert isinstance(create_context(), Context)


def test_a_context_born_with_an_error_is_released_and_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    released: list[bool] = []

    class Context:
        error = "GL_OUT_OF_MEMORY"

        def release(self) -> None:
            released.append(True)

    monkeypatch.setattr(moderngl, "create_context", lambda **settings: Context())
    with pytest.raises(RendererError, match="GL reported GL_OUT_OF_MEMORY while making the context"):
        create_context()
    assert released
