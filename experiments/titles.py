"""What each benchmark page holds, as its title: by the page's file, which is named after its command."""

TITLES = {
    "allocations": "How many solves each optimiser needs for a tolerance allocation",
    "batches": "Batches: time per sample",
    "bifurcation": "Bifurcation diagram of a slider-crank over its clearance",
    "calibration": "Calibration: how often the intervals hold the truth",
    "contact_laws": "Contact laws: restitution delivered, bias of a smooth onset",
    "cores": "Batches on several cores: gain, order of samples, memory",
    "derivatives": "Error of derivatives over the tolerance",
    "derivatives_closed_forms": "Derivatives against closed forms",
    "derivatives_cost": "Cost of a Jacobian beside its value",
    "derivatives_ladder": "Error of derivatives by parameter and tolerance, beside other tools",
    "exponential_cost_closed_form": "Allocations whose exact answer is known",
    "fidelities": "Solves of the dynamics saved by a search over poses",
    "forward_dynamics": "Cost of accelerations, beside articulated bodies, MuJoCo and pinocchio",
    "gpu": "Batches and sweeps on a GPU",
    "hard": "Cases that are difficult for contact solvers",
    "impacts": "Impacts by every law: errors of derivatives, solves that end early",
    "largest_clearance": "The largest clearance of a robot's joint",
    "memory": "Laws with memory: steps and rejected steps",
    "needs": "What friction, clearance and gravity cost a scene",
    "operations": "Arithmetic that the compiler repeats in a step",
    "paper": "Qian et al. 2022: figures and claims, tested one by one",
    "paper_sweeps": "Qian et al. 2022: studies over clearances, drives and friction",
    "paper_wear": "Qian et al. 2022: wear of the joint",
    "play_in_space": "Play in space: cost, and the limit of zero clearance",
    "published": "Published numbers, the IFToMM benchmarks, Exudyn and MuJoCo",
    "quasi_static": "Quasi-static poses: how far they can be believed",
    "robot_arm": "Design of an arm with play in all six joints",
    "robots": "Dynamics of published robots, compared with pinocchio",
    "scalar": "Batches against a scalar C program",
    "searches": "Design searches judged by sweeps",
    "settled_starts": "Settled starts of a moving robot",
    "sweeps": "Sweeps: throughput, memory, interruption and resume",
    "tool_changer": "Design of the tool-changing robot",
    "trust": "How often the gradient report is right",
    "wear_checks": "Wear against closed forms and published findings",
    "wear_jumps": "Wear by jumps over cycles against every cycle",
    "wear_kills": "Wear runs that were killed and resumed",
    "work_precision": "Work and precision: time against error for every solver",
    "yield_design": "The largest clearance for a yield of 99 %",
    "yields": "How many designs have the yield that was asked for",
}


def title(stem: str) -> str:
    """The title of a page; of a page that is not in the list, its file's name in words."""
    return TITLES.get(stem, stem.replace("_", " ").capitalize())
