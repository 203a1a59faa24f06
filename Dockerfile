# The program in an image of Debian 13 slim, for a user without rights: docker build -t earshot . && docker run --rm earshot doctor
# scripts/check_image.sh runs the steps of the last stage without a container engine.
FROM debian:trixie-slim AS build
WORKDIR /root/earshot
COPY . .
RUN scripts/image_build.sh /package

FROM debian:trixie-slim
COPY scripts/image_runtime.sh /package/
COPY --from=build /package /package
RUN /package/image_runtime.sh /package
USER earshot
WORKDIR /home/earshot
ENTRYPOINT ["earshot"]
CMD ["--help"]
