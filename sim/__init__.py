"""The bridge to MuJoCo: mechanisms read from models, excitation, simulation, and recordings."""
