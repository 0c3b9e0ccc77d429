"""Operations on scalars, arrays and JAX, so that physics is written once."""
