"""What ``optsim study paper-claims`` runs: how many scenes, masks, levels of light, at which sizes."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from optsim.errors import InputError

Electrons = Annotated[float, Field(ge=1, le=1e9, allow_inf_nan=False)]


class ClaimsConfig(BaseModel):
    """Describe the study of the paper's claims.

    Scenes and masks are both random: every random scene has ``masks`` masks of its own. The two targets share
    ``target_masks`` masks, so that their difference is paired too.

    Args:
        seed: root of every random stream, 0 to 2^32 - 1.
        size: mirrors along each side, 32 to 512.
        scenes: random scenes besides the two targets, 2 to 1000.
        masks: of each random scene in the matched base, 1 to 100.
        target_masks: of the two targets in the base readings, 2 to 100.
        few_masks: of each random scene where one factor is changed.
        few_target_masks: of the targets there, at least 2.
        groups: colour shots of the matched base; R = 3 groups / 24.
        physical_groups: colour shots of the physical base on the targets; random scenes are run at the first.
        light_e: charge of the brightest pixel of one monochrome shot, in electrons, for the curve against light.
        budget_e: levels at which all six light budgets are compared; one of them is ``noise_e``.
        noise_e: the level at which other factors under noise are changed.
        light_scenes: random scenes of the readings with noise, at most ``scenes``.
        large: mirrors along each side for the base once more; None: not run.
        large_masks: how many there.
        large_scenes: random scenes there, one mask each, at R = 1/8; at most ``scenes``.
        bench_masks: of the test bed's bricks, at least 2.
        bench_groups: colour shots there.
        bench_size: mirrors along each side of the test bed.
        render_error: relative error of the renders.
        workers: solves side by side; None: one a core.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    seed: int = Field(0, ge=0, le=2**32 - 1)
    size: int = Field(128, ge=32, le=512)
    scenes: int = Field(20, ge=2, le=1000)
    masks: int = Field(5, ge=1, le=100)
    target_masks: int = Field(10, ge=2, le=100)
    few_masks: int = Field(1, ge=1, le=100)
    few_target_masks: int = Field(5, ge=2, le=100)
    groups: tuple[Annotated[int, Field(ge=1, le=8)], ...] = Field((1, 2, 3, 4), min_length=1)
    physical_groups: tuple[Annotated[int, Field(ge=1, le=8)], ...] = Field((1, 4), min_length=1)
    light_e: tuple[Electrons, ...] = Field((50, 160, 500, 1600, 5000, 16000, 50000), min_length=1)
    budget_e: tuple[Electrons, ...] = Field((50, 500, 5000, 50000), min_length=1)
    noise_e: Electrons = 5000
    light_scenes: int = Field(10, ge=2, le=1000)
    large: int | None = Field(256, ge=32, le=1024)
    large_masks: int = Field(5, ge=2, le=100)
    large_scenes: int = Field(10, ge=0, le=1000)
    bench_masks: int = Field(5, ge=2, le=100)
    bench_groups: tuple[Annotated[int, Field(ge=1, le=8)], ...] = Field((1, 4), min_length=1)
    bench_size: int = Field(128, ge=32, le=512)
    render_error: float = Field(0.01, gt=1e-4, le=1)
    workers: int | None = Field(None, ge=1, le=256)

    @model_validator(mode="after")
    def _consistent(self) -> ClaimsConfig:
        within = (("few_masks", "masks"), ("few_target_masks", "target_masks"), ("light_scenes", "scenes"), ("large_scenes", "scenes"))
        for small, large in within:
            if getattr(self, small) > getattr(self, large):
                raise InputError(small, getattr(self, small), f"at most {large}, {getattr(self, large)}")
        if self.noise_e not in self.budget_e:
            raise InputError("noise_e", self.noise_e, f"one of budget_e, {self.budget_e}")
        for name in ("groups", "physical_groups", "bench_groups"):
            values = getattr(self, name)
            if 1 not in values or list(values) != sorted(set(values)):
                raise InputError(name, values, "rising, with 1 among them (R = 1/8 is where factors are changed)")
        if self.large is not None and self.large == self.size:
            raise InputError("large", self.large, f"another size than {self.size}")
        return self

    @classmethod
    def quick(cls, seed: int = 0) -> ClaimsConfig:
        """Return the quick form: 40 x 40, three random scenes, R = 1/8 and 1/2, meant for five minutes on two cores."""
        return cls(
            seed=seed,
            size=40,
            scenes=3,
            masks=1,
            target_masks=6,
            few_masks=1,
            few_target_masks=2,
            groups=(1, 4),
            physical_groups=(1,),
            light_e=(50, 5000, 50000),
            budget_e=(5000,),
            light_scenes=2,
            large=None,
            large_scenes=0,
            bench_masks=3,
            bench_groups=(1,),
            bench_size=40,
            render_error=0.02,
        )
