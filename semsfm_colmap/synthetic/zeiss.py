"""The header that Zeiss microscopes put into their TIFF files, tag 34118."""

from __future__ import annotations

from semsfm_colmap.synthetic.databar import BarText, magnification

CZ_SEM_TAG = 34118
NUM_LEADING_VALUES = 28
"""Lines of bare numbers before the named entries, four display settings of seven values."""


def length_with_unit(length_um: float) -> str:
    """A length as the header writes it, four significant digits and a unit."""
    for unit, size_um in (("mm", 1e3), ("µm", 1.0), ("nm", 1e-3)):
        if length_um >= size_um:
            return f"{length_um / size_um:.4g} {unit}"
    return f"{length_um * 1e6:.4g} pm"


def cz_sem_header(
    text: BarText,
    *,
    width: int,
    height: int,
    tilt_deg: float,
    file_name: str,
) -> bytes:
    """The bytes of the tag: lines ended by CR LF, in Latin-1, the first ones bare numbers.

    Parameters
    ----------
    text : pixel size, beam energy and working distance
    width, height : of the stored image, px
    tilt_deg : of the stage
    file_name : of the image

    """
    pixel_m = text.pixel_size_um * 1e-6
    mag = magnification(width, text.pixel_size_um)
    kev, wd_mm = text.beam_energy_kev, text.working_distance_mm
    leading = [0.0, 0.0, 0.0, pixel_m, mag, 6, kev * 1e3, 2.309, 2e-7, wd_mm * 1e-3]
    values = [f"{v:.6e}" if isinstance(v, float) else str(v) for v in leading]
    values += ["0"] * (NUM_LEADING_VALUES - len(values))
    pixel = length_with_unit(text.pixel_size_um)
    entries = [
        ("DP_DETECTOR_CHANNEL", "Signal A = SE2"),
        ("DP_FROZEN", "Image = Frozen"),
        ("DP_TILT_CORRECTION", "Tilt Corrn. = Off"),
        ("DP_IMAGE_STORE", f"Store resolution = {width} * {height}"),
        ("AP_WD", f"WD = {wd_mm:.1f} mm"),
        ("AP_MAG", f"Mag = {mag:.0f} X"),
        ("AP_PIXEL_SIZE", f"Pixel Size = {pixel}"),
        ("AP_IMAGE_PIXEL_SIZE", f"Image Pixel Size = {pixel}"),
        ("AP_WIDTH", f"Width = {length_with_unit(width * text.pixel_size_um)}"),
        ("AP_HEIGHT", f"Height = {length_with_unit(height * text.pixel_size_um)}"),
        ("AP_STAGE_AT_T", f"Stage at T = {tilt_deg:.1f} °"),
        ("AP_STAGE_AT_R", "Stage at R = 0.0 °"),
        ("AP_TILT_ANGLE", "Tilt Angle = 0.0 °"),
        ("AP_ACTUALKV", f"EHT = {kev:.2f} kV"),
        ("AP_DATE", "Date :1 Jan 2000"),
        ("AP_TIME", "Time :0:00:00"),
        ("SV_VERSION", "Version = V05.04.03.00 : 16-Apr-10"),
        ("SV_SERIAL_NUMBER", "Serial No. = SYNTHETIC"),
        ("SV_FILE_NAME", f"File Name = {file_name}"),
    ]
    lines = [*values, str(len(entries))]
    for key, value in entries:
        lines += [key, value]
    return ("\r\n".join(lines) + "\r\n\0").encode("latin-1")
