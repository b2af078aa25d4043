"""Compare two estimators and one of your own, at two noise levels; saves compare.png."""

import olne_bench as ob


class Guess:
    """Guesses weights at random."""

    def estimate(self, problem, observation, *, rng, budget):
        return ob.Estimate(rng.dirichlet([1] * problem.game.num_weights, problem.game.num_players))


scenario = ob.scenario("two_player")
problem, seen = ob.observe(scenario, sensor="partial", sigma=0.05)
print(seen, ob.estimate(problem, seen, "map").summary(), sep="\n")
methods = ["map", "kkt_residual", Guess()]
result = ob.compare(scenario, methods, sensor="partial", sigma=[0.02, 0.1], seeds=3)
print(result)
result.plot().savefig("compare.png")
