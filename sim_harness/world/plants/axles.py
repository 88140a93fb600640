"""Distribution of mass and tyre stiffness between the axles for a given understeer gradient.

    K_us = m_f/C_f - m_r/C_r        [rad/(m/s²)]    Rajamani, Vehicle Dynamics and Control (2012), section 3.3

with the masses m_f, m_r on the axles and the cornering stiffnesses C_f, C_r [N/rad]. The rear stiffness is given,
the front follows from K_us of the unloaded vehicle. A load changes the masses but not the stiffnesses (tyres
gain some stiffness with load; leaving that out is the harder case).
"""

from dataclasses import dataclass

from sim_harness.world.plants.settings import PlantSettings
from trepid.car.vehicle import Vehicle
from trepid.config import InputError

GRAVITY_MPS2 = 9.80665
ANTI_LOCK = 0.95  # largest share of the grip that brakes and drive use, so that the tyres still steer


@dataclass(frozen=True, slots=True, kw_only=True)
class Axles:
    """The loaded vehicle on its two axles."""

    mass_kg: float
    yaw_inertia_kgm2: float
    cg_to_front_m: float
    cg_to_rear_m: float
    front_stiffness_nprad: float
    rear_stiffness_nprad: float

    @property
    def front_mass_kg(self) -> float:
        """Mass that the front axle carries."""
        return self.mass_kg * self.cg_to_rear_m / (self.cg_to_front_m + self.cg_to_rear_m)

    @property
    def rear_mass_kg(self) -> float:
        """Mass that the rear axle carries."""
        return self.mass_kg - self.front_mass_kg

    @property
    def understeer_gradient_rad_per_mps2(self) -> float:
        """K_us as loaded."""
        front = self.front_mass_kg / self.front_stiffness_nprad
        return front - self.rear_mass_kg / self.rear_stiffness_nprad


def axles_of(vehicle: Vehicle, settings: PlantSettings) -> Axles:
    """The axles of ``vehicle`` under ``settings``. Raises InputError when no front stiffness fits the gradient."""
    chassis, wheelbase_m = settings.chassis, vehicle.wheelbase_m
    front_kg = chassis.mass_kg * chassis.front_share
    rear_kg = chassis.mass_kg - front_kg
    rear_nprad = chassis.rear_stiffness_per_rad * rear_kg * GRAVITY_MPS2
    front_compliance = vehicle.understeer_gradient_rad_per_mps2 + rear_kg / rear_nprad
    if front_compliance <= 0.0:
        raise InputError(
            f"plant: an understeer gradient of {vehicle.understeer_gradient_rad_per_mps2} rad/(m/s²) "
            f"needs rear tyres softer than {chassis.rear_stiffness_per_rad} per rad"
        )
    mass_kg = chassis.mass_kg + settings.load_kg
    # Distances ahead of the rear axle: a mass counts on the front axle by its distance over the wheelbase.
    empty_m = wheelbase_m * chassis.front_share
    load_m = wheelbase_m * chassis.load_front_share
    cg_m = (chassis.mass_kg * empty_m + settings.load_kg * load_m) / mass_kg
    inertia = chassis.yaw_inertia_index * chassis.mass_kg * empty_m * (wheelbase_m - empty_m)
    inertia += chassis.mass_kg * (empty_m - cg_m) ** 2 + settings.load_kg * (load_m - cg_m) ** 2
    return Axles(
        mass_kg=mass_kg,
        yaw_inertia_kgm2=inertia,
        cg_to_front_m=wheelbase_m - cg_m,
        cg_to_rear_m=cg_m,
        front_stiffness_nprad=front_kg / front_compliance,
        rear_stiffness_nprad=rear_nprad,
    )
