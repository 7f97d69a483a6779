"""Design of controllers: criteria, margins, tuning."""
