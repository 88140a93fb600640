"""A vehicle file gives its understeer once: as a gradient, or as mass and tyres."""

import pytest

from trepid.car.vehicle import Chassis, Vehicle, understeer_gradient
from trepid.config import CONFIG_DIR, InputError, load

FILE = CONFIG_DIR / "vehicle.yaml"
RAV4 = dict(
    mass_kg=1792.0, cg_to_front_m=1.325, front_stiffness_nprad=108572.0, rear_stiffness_nprad=171630.0
)
GIVEN = "understeer_gradient_rad_per_mps2: 0.00356"
CHASSIS = (
    "chassis: {mass_kg: 1000, cg_to_front_m: 0.7, front_stiffness_nprad: 60000, rear_stiffness_nprad: 8e4}"
)


def write_vehicle(folder, understeer):
    """The default vehicle with ``understeer`` in the place of its gradient."""
    path = folder / "car.yaml"
    text = FILE.read_text(encoding="utf-8")
    assert GIVEN in text
    path.write_text(text.replace(GIVEN, understeer), encoding="utf-8")
    return path


def test_the_gradient_is_the_difference_of_the_compliances_of_the_axles():
    """A Toyota RAV4 with opendbc's figures: 1.70 deg/g."""
    gradient = understeer_gradient(wheelbase_m=2.65, **RAV4)
    assert gradient == pytest.approx(896.0 / 108572.0 - 896.0 / 171630.0)
    assert gradient == pytest.approx(0.00303, abs=5e-6)


def test_more_weight_ahead_understeers_and_the_balanced_car_is_neutral():
    gradients = [
        understeer_gradient(
            mass_kg=1000.0,
            wheelbase_m=2.0,
            cg_to_front_m=to_front_m,
            front_stiffness_nprad=5e4,
            rear_stiffness_nprad=5e4,
        )
        for to_front_m in (0.8, 1.0, 1.2)
    ]
    assert gradients == [pytest.approx(0.004), pytest.approx(0.0, abs=1e-18), pytest.approx(-0.004)]


def test_a_file_may_give_mass_and_tyres_instead_and_the_vehicle_keeps_the_gradient(tmp_path):
    car = load(write_vehicle(tmp_path, CHASSIS), Vehicle)
    assert car.chassis == Chassis(
        mass_kg=1000.0, cg_to_front_m=0.7, front_stiffness_nprad=60000.0, rear_stiffness_nprad=80000.0
    )
    assert car.understeer_gradient_rad_per_mps2 == pytest.approx(600 / 60000 - 400 / 80000)
    again = Vehicle.model_validate(car.model_dump() | {"understeer_gradient_rad_per_mps2": 0.002})
    assert again.understeer_gradient_rad_per_mps2 == 0.002


@pytest.mark.parametrize(
    "understeer,message",
    [
        ("", "'understeer_gradient_rad_per_mps2' is missing; 'chassis' would do instead"),
        (f"{GIVEN}\n{CHASSIS}", "car.yaml:14:1: chassis: gives the understeer, and so does"),
        (CHASSIS.replace("0.7", "1.75"), "car.yaml:13:26: chassis.cg_to_front_m: the centre of gravity must"),
        (CHASSIS.replace("1000", "-1"), "chassis.mass_kg: Input should be greater than 0"),
        (CHASSIS.replace("mass_kg", "mas_kg"), "did you mean 'mass_kg'"),
    ],
)
def test_a_file_with_two_or_no_values_of_understeer_is_refused_with_its_place(tmp_path, understeer, message):
    with pytest.raises(InputError) as refused:
        load(write_vehicle(tmp_path, understeer), Vehicle)
    assert message in str(refused.value)


def test_the_slip_of_the_rear_axle_is_its_mass_over_its_stiffness_or_as_given_or_none(tmp_path):
    assert load(write_vehicle(tmp_path, CHASSIS), Vehicle).rear_slip_gradient_rad_per_mps2 == pytest.approx(
        1000.0 * 0.7 / 1.75 / 8e4
    )
    assert load(write_vehicle(tmp_path, GIVEN), Vehicle).rear_slip_gradient_rad_per_mps2 == 0.0
    given = load(write_vehicle(tmp_path, f"{GIVEN}\nrear_slip_gradient_rad_per_mps2: 0.005"), Vehicle)
    assert given.rear_slip_gradient_rad_per_mps2 == 0.005
    with pytest.raises(InputError, match="chassis: gives the slip of the rear axle, and so does"):
        load(write_vehicle(tmp_path, f"{CHASSIS}\nrear_slip_gradient_rad_per_mps2: 0.005"), Vehicle)
