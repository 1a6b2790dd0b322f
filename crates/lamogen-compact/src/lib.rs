//! A compact text-to-motion model for lamogen, embedded (CC BY-NC 4.0)
