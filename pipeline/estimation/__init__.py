"""What the photograph says about its light: directions and intensities from annotations."""
