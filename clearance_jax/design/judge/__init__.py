"""The judgement of an answer: verification, standings, budget, explanations, standard fits."""
