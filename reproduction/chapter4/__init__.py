"""Chapter 4: models judged by their controllers, PI, PDPC and ILQR."""
