"""Chapter 2: models from open-loop, bounded and closed-loop experiments."""
