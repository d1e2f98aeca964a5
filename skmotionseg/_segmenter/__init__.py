"""What :class:`~skmotionseg.MotionSegmenter` is made of."""
