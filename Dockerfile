# flexarm on an installed ROS 2: the steps of docs/howto/ros2_installation.md, as commands.
#   docker build -t flexarm .
#   docker run --rm -it flexarm                       the arm, simulated
#   docker exec -it CONTAINER /ros_entrypoint.sh bash -c '. install/setup.bash && flexarm reference 2'
FROM ros:jazzy

RUN apt-get update \
    && apt-get install -y --no-install-recommends python3-venv ros-jazzy-robot-state-publisher \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /flexarm
COPY src src
COPY requirements requirements

# What has a key of rosdep comes from Ubuntu and ROS, the rest from PyPI into an environment that sees those.
RUN apt-get update && rosdep update \
    && rosdep install --from-paths src --ignore-src -y --skip-keys python3-rosbags-pip \
    && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv --system-site-packages /opt/flexarm \
    && /opt/flexarm/bin/pip install --no-cache-dir -r requirements/base.in -r requirements/colcon.in

# colcon of the environment: the nodes run with the Python that built them.
ENV PATH=/opt/flexarm/bin:$PATH
RUN . /opt/ros/jazzy/setup.sh && colcon build --base-paths src

CMD ["bash", "-c", ". install/setup.bash && exec ros2 launch flexarm_bringup laboratory.launch.py"]
