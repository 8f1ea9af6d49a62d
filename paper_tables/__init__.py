"""The paper's published figures and the tables drawn beside them."""
